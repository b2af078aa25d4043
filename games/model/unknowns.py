"""Numbers of a game that estimators have to find: target speeds, goals, desired distances.

A feature may hold an ``Unknown`` in place of any number. ``Game.parameters`` lists them, and
``Game.known`` gives the game in which they have certain values. Solvers treat unknowns like
weights. They see a *standardised* parameter s, with value = mean + deviation * s, so that all of
theta is of one size.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from functools import cached_property
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Unknown:
    """A number that is not known, and what is known about it.

    Two features of a player that hold unknowns of the same name share the number. Raises ValueError
    on a range without width, a mean outside of it, or a deviation that is not positive; the message
    names the parameter.

    Attributes:
        name: of the parameter, such as ``target speed``.
        unit: such as ``m/s``.
        low: the number is above.
        high: the number is below.
        mean: of the Gaussian that describes it before any observation.
        deviation: its standard deviation.
    """

    name: str
    unit: str
    low: float
    high: float
    mean: float
    deviation: float

    def __post_init__(self) -> None:
        numbers = {"low": self.low, "high": self.high, "mean": self.mean}
        for label, number in numbers.items() | {("deviation", self.deviation)}:
            if not math.isfinite(number):
                raise ValueError(f"unknown {self.name!r}: {label} must be finite, got {number}")
        if not self.low < self.high:
            raise ValueError(
                f"unknown {self.name!r}: the range from {self.low} to {self.high} {self.unit} "
                "has no width"
            )
        if not self.low < self.mean < self.high:
            raise ValueError(
                f"unknown {self.name!r}: the mean {self.mean} is not within the range from "
                f"{self.low} to {self.high} {self.unit}"
            )
        if not self.deviation > 0:
            raise ValueError(
                f"unknown {self.name!r}: the deviation must be positive, got {self.deviation}"
            )

    def value(self, standardised: Any) -> Any:
        """The number in its unit, from a standardised one."""
        return self.mean + self.deviation * standardised

    def standardised(self, value: Any) -> Any:
        """The inverse of ``value``."""
        return (value - self.mean) / self.deviation


def unknowns_of(thing: Any) -> tuple[Unknown, ...]:
    """The unknowns of a dataclass or a tuple of them, in order; ValueError if one name differs."""
    found: dict[str, Unknown] = {}

    def note(unknown: Unknown) -> Unknown:
        if found.setdefault(unknown.name, unknown) != unknown:
            raise ValueError(
                f"the unknown {unknown.name!r} of a player is declared twice and differently"
            )
        return unknown

    with_unknowns(thing, note)
    return tuple(found.values())


def with_unknowns(thing: Any, change: Callable[[Unknown], Any]) -> Any:
    """A copy of a dataclass, or of a tuple of them, with every unknown changed."""
    if isinstance(thing, Unknown):
        return change(thing)
    if isinstance(thing, tuple):
        parts = [with_unknowns(part, change) for part in thing]
        return tuple(parts) if type(thing) is tuple else type(thing)(*parts)
    if not is_dataclass(thing) or isinstance(thing, type):
        return thing
    own = {field.name: getattr(thing, field.name) for field in fields(thing)}
    changed = {name: with_unknowns(value, change) for name, value in own.items()}
    if all(changed[name] is own[name] for name in own):
        return thing
    copy = object.__new__(type(thing))  # checks of numbers may not take symbols
    for name, value in changed.items():
        object.__setattr__(copy, name, value)
    return copy


def at_means(thing: Any) -> Any:
    """A copy with the mean in place of every unknown."""
    return with_unknowns(thing, lambda unknown: unknown.mean)


@dataclass(frozen=True)
class Parameters:
    """The unknowns of each player of a game as an array (N, U), its columns in each player's order.

    A player that has fewer unknowns than another has columns that stand for nothing.
    """

    unknowns: tuple[tuple[Unknown, ...], ...]

    @cached_property
    def count(self) -> int:
        """U, the number of unknowns of the player that has most."""
        return max(map(len, self.unknowns), default=0)

    @cached_property
    def means(self) -> np.ndarray:
        """(N, U) of the priors; NaN in columns that stand for nothing."""
        return self._table("mean")

    @cached_property
    def deviations(self) -> np.ndarray:
        """(N, U) of the priors; NaN in columns that stand for nothing."""
        return self._table("deviation")

    @cached_property
    def used(self) -> np.ndarray:
        """(N, U) whether a column stands for something."""
        return np.asarray(np.isfinite(self.means))

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Standardised ranges (N, U), twice; infinite in columns that stand for nothing."""
        low, high = ((self._table(side) - self.means) / self.deviations for side in ("low", "high"))
        return np.where(self.used, low, -np.inf), np.where(self.used, high, np.inf)

    def values(self, standardised: np.ndarray) -> np.ndarray:
        """Values (..., N, U) in their units; NaN in columns that stand for nothing."""
        return np.asarray(self.means + self.deviations * standardised)

    def standardised(self, values: np.ndarray) -> np.ndarray:
        """Standardised (..., N, U); zero in columns that stand for nothing."""
        return np.where(self.used, (values - self.means) / self.deviations, 0.0)

    def check(self, values: np.ndarray) -> np.ndarray:
        """Values (N, U) as float64; ValueError on a wrong shape, or one missing or out of range."""
        values = np.asarray(values, dtype=float)
        if values.shape != (len(self.unknowns), self.count):
            raise ValueError(
                f"parameters have the shape {values.shape}, expected "
                f"{(len(self.unknowns), self.count)}"
            )
        for i, own in enumerate(self.unknowns):
            for unknown, value in zip(own, values[i], strict=False):
                if not unknown.low <= value <= unknown.high:
                    raise ValueError(
                        f"player {i}: {unknown.name} must be from {unknown.low} to "
                        f"{unknown.high} {unknown.unit}, got {value}"
                    )
        return values

    def _table(self, name: str) -> np.ndarray:
        table = np.full((len(self.unknowns), self.count), np.nan)
        for row, own in zip(table, self.unknowns, strict=True):
            row[: len(own)] = [getattr(unknown, name) for unknown in own]
        table.setflags(write=False)  # it is kept
        return table


def only_weights(parameters: Parameters) -> str | None:
    """Why a method that estimates weights only cannot take a game; None if it can."""
    for i, own in enumerate(parameters.unknowns):
        if own:
            names = ", ".join(unknown.name for unknown in own)
            return f"estimates weights only, but player {i} has unknowns: {names}"
    return None


def refuse_unknowns(parameters: Parameters, who: str) -> None:
    """Refuse unknowns besides weights; ValueError names who refuses, player and parameters."""
    if reason := only_weights(parameters):
        raise ValueError(f"{who} {reason}")
