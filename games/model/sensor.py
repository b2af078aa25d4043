"""Sensors as stacks of layers, and what an estimator may know of a sensor.

A view defines what is observed, a noise layer how its noise is correlated (C is diagonal without
one), a gaps layer which samples are missing. One convention holds for any order of layers:

    y = h(x) + noise,  noise ~ N(0, sigma^2 C);  then gaps, whole blocks of a player, NaN.

Only the order of views matters: each observes the output of the one below. PettingZoo wrappers
apply the same layers to worlds (``envs.worlds.wrappers.wrap``).
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from olne_bench.games.model.observation import (
    Components,
    View,
    observation_size,
    stacked,
    whitening,
)


class NoiseLayer(ABC):
    """The distribution of the noise on a player's observed components."""

    @abstractmethod
    def covariance(self, scale: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
        """Covariance (d, d) over sigma^2 from scales (d,) and names; ValueError on a misfit."""


@dataclass(frozen=True)
class CorrelatedNoise(NoiseLayer):
    """Equal correlation between the named components; the scales remain those of the view.

    Attributes:
        correlation: above -1/(k-1) and below 1 for k components.
        components: names of the components; all observed ones if empty.
    """

    correlation: float
    components: tuple[str, ...] = ()

    def covariance(self, scale: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
        chosen = self.components or names
        for name in chosen:
            if name not in names:
                raise ValueError(
                    f"correlated noise: no component {name!r} is seen; there are: "
                    f"{', '.join(names)}"
                )
        least = -1 / max(1, len(chosen) - 1)
        if not least < self.correlation < 1:
            raise ValueError(
                f"correlation must be above {least:.3g} and below 1 for {len(chosen)} components, "
                f"got {self.correlation}"
            )
        columns = [names.index(name) for name in chosen]
        correlations = np.eye(len(names))
        correlations[np.ix_(columns, columns)] = self.correlation
        np.fill_diagonal(correlations, 1.0)
        return correlations * np.outer(scale, scale)


@dataclass(frozen=True)
class CovarianceNoise(NoiseLayer):
    """A covariance (d, d) relative to sigma^2, in components' units, for the view's scales."""

    matrix: tuple[tuple[float, ...], ...]

    def covariance(self, scale: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
        rows = [len(row) for row in self.matrix]
        if rows != [len(names)] * len(names):
            raise ValueError(
                f"the covariance has rows of {rows} numbers, expected {len(names)} rows of "
                f"{len(names)}: {', '.join(names)}"
            )
        return np.array(self.matrix, dtype=float)


class GapsLayer(ABC):
    """Decides which players are missed in a step."""

    @abstractmethod
    def missed(self, rng: np.random.Generator, blocks: np.ndarray) -> np.ndarray:
        """Mask (N,) of players missed in blocks (N, d) with noise, NaN where already missed."""


@dataclass(frozen=True)
class Drops(GapsLayer):
    """Each player is missed with probability p, independently; ValueError on p out of range."""

    p: float

    def __post_init__(self) -> None:
        if not 0 <= self.p <= 1:
            raise ValueError(f"p must be a probability between 0 and 1, got {self.p}")

    def missed(self, rng: np.random.Generator, blocks: np.ndarray) -> np.ndarray:
        return rng.random(len(blocks)) < self.p


Layer: TypeAlias = View | NoiseLayer | GapsLayer


@dataclass(frozen=True)
class Stack:
    """The layers of a sensor by kind: views as one, noise (None if independent), gaps in order."""

    view: View
    noise: NoiseLayer | None
    gaps: tuple[GapsLayer, ...]

    @classmethod
    def of(cls, layers: Sequence[Layer]) -> "Stack":
        """Sort layers; ValueError on two noise layers, or on an object that is not a layer."""
        for layer in layers:
            if not isinstance(layer, View | NoiseLayer | GapsLayer):
                raise ValueError(
                    f"{layer!r} is not a layer of a sensor; layers are views, noise and gaps"
                )
        noise = [layer for layer in layers if isinstance(layer, NoiseLayer)]
        if len(noise) > 1:
            raise ValueError(f"a sensor has one noise layer at most, got {len(noise)}: {noise}")
        return cls(
            view=stacked([layer for layer in layers if isinstance(layer, View)]),
            noise=noise[0] if noise else None,
            gaps=tuple(layer for layer in layers if isinstance(layer, GapsLayer)),
        )


@dataclass(frozen=True)
class SensorModel:
    """What an estimator may know of a sensor: its view h, whether samples may be missing.

    Covariance (d, d) is C, that of the noise on h(x) relative to sigma^2.
    """

    view: View
    covariance: tuple[tuple[float, ...], ...]
    may_miss: bool

    @classmethod
    def of(
        cls,
        layers: Sequence[Layer],
        dynamics: Components,
        noise_scale: Sequence[float] | np.ndarray,
    ) -> "SensorModel":
        """The model of a stack of layers, of which only the order of views matters.

        Noise scales (n,) are the scenario's standard deviations relative to sigma. Raises
        ValueError on layers that do not fit each other or the state, or a covariance that is not
        positive definite.
        """
        stack = Stack.of(layers)
        observation_size(stack.view, dynamics)  # raises if a view does not fit
        names = stack.view.component_names(dynamics)
        scale = stack.view.noise_scale(np.asarray(noise_scale, dtype=float), dynamics)
        covariance = np.diag(scale**2)
        if stack.noise is not None:
            covariance = stack.noise.covariance(scale, names)
        whitening(covariance)
        rows = tuple(tuple(float(value) for value in row) for row in covariance)
        return cls(stack.view, rows, bool(stack.gaps))

    @cached_property
    def noise_scale(self) -> tuple[float, ...]:
        """(d,) standard deviations relative to sigma."""
        return tuple(float(value) for value in np.sqrt(np.diag(self.covariance)))

    @cached_property
    def noise_covariance(self) -> tuple[tuple[float, ...], ...] | None:
        """The covariance if components are correlated, else None."""
        diagonal = np.diag(np.diag(self.covariance))
        return None if np.array_equal(self.covariance, diagonal) else self.covariance
