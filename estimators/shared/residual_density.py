"""Densities pi(x) = exp(-|F(x)|^2 / 2), known at many points together with the derivative of F.

F holds all errors over their standard deviations, those of the prior as well. What gives F may need
a known place nearby, as a game needs a known equilibrium.
"""

from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np

#: The shortest part of a Gauss-Newton step that is tried, and a gain that is none.
_SHORTEST, _FLAT = 1e-3, 1e-4


@dataclass(frozen=True)
class Places:
    """B points and what is known of F there. Where F has no value, it is zero.

    Attributes:
        points: (B, d).
        errors: F (B, O).
        rows: (B,) arrays (O, d), its derivatives, which are not copied where places are.
        possible: (B,) whether F has a value.
        roots: (B, ...) what further points are followed from; only the density reads it.
        responses: (B, ...) its derivative, or (B,) objects that hold one each.
    """

    points: np.ndarray
    errors: np.ndarray
    rows: np.ndarray
    possible: np.ndarray
    roots: np.ndarray
    responses: np.ndarray

    def __len__(self) -> int:
        return len(self.points)

    @property
    def log_density(self) -> np.ndarray:
        """Log pi (B,)."""
        return np.where(self.possible, -np.sum(self.errors**2, axis=1) / 2, -np.inf)

    def at(self, chosen: np.ndarray) -> "Places":
        """Those of some indices, or where a mask is true."""
        return Places(*(part[chosen] for part in self._parts()))

    def put(self, chosen: np.ndarray, others: "Places") -> None:
        """Overwrite those of some indices."""
        for part, other in zip(self._parts(), others._parts(), strict=True):
            part[chosen] = other

    def _parts(self) -> list[np.ndarray]:
        return [getattr(self, field.name) for field in fields(self)]


class Density(Protocol):
    """F at any points."""

    def reach(self, points: np.ndarray, near: Places) -> Places:
        """F at points (B, d), each followed from one of B places that are possible."""


def climbed(density: Density, place: Places, most: int) -> Places:
    """The most probable point near one place, or what as many Gauss-Newton steps reach."""
    for _ in range(most):
        step, share = -np.linalg.lstsq(place.rows[0], place.errors[0])[0], 1.0
        before = place.log_density[0]
        while share > _SHORTEST:
            trial = density.reach(place.points + share * step, place)
            if trial.log_density[0] > before:
                break
            share /= 2
        else:
            return place
        place = trial
        if place.log_density[0] - before < _FLAT:
            return place
    return place
