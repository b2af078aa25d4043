"""Sensors as stacks of layers, and what an estimator may know of one.

A layer is plain data. A view says what is seen, a noise layer how noise on it is correlated, a gaps
layer which samples are missed. Whatever their order in a stack, one convention holds:

    y = h(x) + noise,  noise ~ N(0, sigma^2 C);  then gaps, whole blocks of a player, NaN.

Only views depend on their order: each looks at what the one below shows. Without a noise layer C is
diagonal, with the squares of the view's noise scales. PettingZoo wrappers apply the very same
layers to worlds (``envs.wrappers.wrap``).
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from olne_bench.games.observation import Components, View, observation_size, stacked, whitening


class NoiseLayer(ABC):
    """How the noise on what is seen of a player is distributed."""

    @abstractmethod
    def covariance(self, scale: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
        """Covariance (d, d) relative to sigma^2.

        Args:
            scale: (d,) noise scales of the view, standard deviations over sigma.
            names: of the d components seen.

        Raises:
            ValueError: if it does not fit those components.
        """


@dataclass(frozen=True)
class CorrelatedNoise(NoiseLayer):
    """The named components have one correlation with each other; scales stay those of the view.

    Attributes:
        correlation: above -1/(k-1) and below 1 for k components.
        components: names, all that are seen where empty.
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
    """A covariance of its own, in place of the scales of the view.

    Attributes:
        matrix: (d, d) relative to sigma^2, in the units of what is seen.
    """

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
    """Which players are missed in a step."""

    @abstractmethod
    def missed(self, rng: np.random.Generator, blocks: np.ndarray) -> np.ndarray:
        """Mask (N,) of the players missed.

        Args:
            rng: a stream of the layer's own.
            blocks: (N, d) what would be seen, noise included; NaN where missed already.
        """


@dataclass(frozen=True)
class Drops(GapsLayer):
    """Every player is missed with probability p, independently of the others and of the past.

    Raises:
        ValueError: if p is no probability.
    """

    p: float

    def __post_init__(self) -> None:
        if not 0 <= self.p <= 1:
            raise ValueError(f"p must be a probability between 0 and 1, got {self.p}")

    def missed(self, rng: np.random.Generator, blocks: np.ndarray) -> np.ndarray:
        return rng.random(len(blocks)) < self.p


Layer: TypeAlias = View | NoiseLayer | GapsLayer


@dataclass(frozen=True)
class Stack:
    """The layers of a sensor, sorted by kind.

    Attributes:
        view: all views as one.
        noise: the noise layer, None for independent noise.
        gaps: the gaps layers, in order.
    """

    view: View
    noise: NoiseLayer | None
    gaps: tuple[GapsLayer, ...]

    @classmethod
    def of(cls, layers: Sequence[Layer]) -> "Stack":
        """Sort layers.

        Raises:
            ValueError: on two noise layers, or on an object that is not a layer.
        """
        for layer in layers:
            if not isinstance(layer, View | NoiseLayer | GapsLayer):
                raise ValueError(f"{layer!r} is no layer of a sensor: a view, noise or gaps")
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
    """What an estimator may know of a sensor.

    Attributes:
        view: observation model h.
        covariance: (d, d) C, covariance of the noise on h(x) relative to sigma^2.
        may_miss: whether samples may be missing.
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
        """The model of a stack of layers.

        Args:
            layers: of the sensor; only the order of views matters.
            dynamics: names the components of a state.
            noise_scale: (n,) of the scenario, standard deviations over sigma.

        Raises:
            ValueError: in one line, on layers that do not fit each other or the state, and on a
                covariance that is not positive definite.
        """
        stack = Stack.of(layers)
        observation_size(stack.view, dynamics)  # a view that does not fit says so
        names = stack.view.component_names(dynamics)
        scale = stack.view.noise_scale(np.asarray(noise_scale, dtype=float), dynamics)
        covariance = np.diag(scale**2)
        if stack.noise is not None:
            covariance = stack.noise.covariance(scale, names)
        whitening(covariance)
        rows = tuple(tuple(float(value) for value in row) for row in covariance)
        return cls(stack.view, rows, bool(stack.gaps))

    @property
    def noise_scale(self) -> tuple[float, ...]:
        """(d,) standard deviations over sigma."""
        return tuple(float(value) for value in np.sqrt(np.diag(self.covariance)))

    @property
    def noise_covariance(self) -> tuple[tuple[float, ...], ...] | None:
        """The covariance where components are correlated, else None."""
        diagonal = np.diag(np.diag(self.covariance))
        return None if np.array_equal(self.covariance, diagonal) else self.covariance
