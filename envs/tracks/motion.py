"""Motion of a car from its track: positions, headings, speeds and their noise."""

from dataclasses import dataclass

import numpy as np

from olne_bench.envs.tracks.table import SLOWEST

_ROUGHNESS_ORDER = 3
_ROUGHNESS_NORM = 20.0  # 1 + 9 + 9 + 1, squared coefficients of a third difference


@dataclass(frozen=True)
class Motion:
    """One player's motion; NaN where unknown.

    Attributes:
        positions: (T, 2) positions [m].
        headings: (T,) headings [rad], given or computed from the positions.
        speeds: (T,) speeds [m/s], given or computed from the positions.
    """

    positions: np.ndarray
    headings: np.ndarray
    speeds: np.ndarray

    @classmethod
    def of(cls, states: np.ndarray, names: list[str], dt: float) -> "Motion":
        """The motion in states (T, n) with these names of components."""
        positions = states[:, :2]
        velocity = _velocity(positions, dt)
        speeds = np.linalg.norm(velocity, axis=1)
        headings = np.where(speeds > SLOWEST, np.arctan2(velocity[:, 1], velocity[:, 0]), np.nan)
        for name, values in zip(names, states.T, strict=True):
            if name == "heading":
                headings = np.where(np.isfinite(values), values, headings)
            if name == "speed":
                speeds = np.where(np.isfinite(values), values, speeds)
        seen = np.isfinite(headings)
        headings[seen] = np.unwrap(headings[seen])
        return cls(positions, headings, speeds)

    @property
    def seen(self) -> np.ndarray:
        """(T,) whether there is a position."""
        return np.isfinite(self.positions).all(axis=1)


def roughness(positions: np.ndarray) -> float:
    """Estimate the noise of positions (T, N, 2) [m] from their roughness.

    The third differences of white noise have the variance 20 sigma^2; those of a motion whose
    acceleration hardly changes within a few steps are about zero. The motion can only add to them,
    so this is an upper estimate. It is NaN if there are no four samples in a row.
    """
    rough = np.diff(positions, n=_ROUGHNESS_ORDER, axis=0)
    rough = rough[np.isfinite(rough)]
    return float(np.sqrt(np.mean(rough**2) / _ROUGHNESS_NORM)) if rough.size else float("nan")


def _velocity(positions: np.ndarray, dt: float) -> np.ndarray:
    """Velocities (T, 2) [m/s] from neighbouring samples; NaN where there are none."""
    seen = np.flatnonzero(np.isfinite(positions).all(axis=1))
    velocity = np.full(positions.shape, np.nan)
    if len(seen) > 1:
        velocity[seen] = np.gradient(positions[seen], seen * dt, axis=0)
    return velocity
