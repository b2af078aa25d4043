"""The room that cars take: gaps between rectangles, and a hard constraint that keeps them apart."""

from dataclasses import dataclass
from itertools import product

import casadi as ca
import numpy as np
from highway_env.vehicle.kinematics import Vehicle

from olne_bench.games.model.costs import Stage

_HALF = np.array([Vehicle.LENGTH, Vehicle.WIDTH]) / 2
_CORNERS = np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)]) * _HALF
#: A car is inside two circles, in the middles of its front and its rear half.
_OFFSET = Vehicle.LENGTH / 4
_RADIUS = float(np.hypot(Vehicle.LENGTH / 4, Vehicle.WIDTH / 2))
_SHARPNESS = 8  # of the smooth minimum
_LEAST = 1e-6  # squared distance [m^2]: the margin has a slope where middles coincide


def gap(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Distance (...) [m] between the cars in states (..., 4); zero where they overlap."""
    between, back = _corners_seen_from(one, other), _corners_seen_from(other, one)
    outside = [_distance(corners).min(axis=-1) for corners in (between, back)]
    # Two rectangles are apart if and only if a side of one of them has the other beyond it.
    apart = np.any([_beyond(corners).any(axis=-1) for corners in (between, back)], axis=0)
    return np.where(apart, np.minimum(*outside), 0.0)


def gaps(states: np.ndarray) -> np.ndarray:
    """Gaps (..., N, N) [m] between all cars in states (..., N, 4), infinite to themselves."""
    found = gap(states[..., :, None, :], states[..., None, :, :])
    count = states.shape[-2]
    found[..., range(count), range(count)] = np.inf
    return found


def _corners_seen_from(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Corners (..., 4, 2) of the other car, along and across the one."""
    cos, sin = np.cos(other[..., 2]), np.sin(other[..., 2])
    x = _CORNERS[:, 0] * cos[..., None] - _CORNERS[:, 1] * sin[..., None]
    y = _CORNERS[:, 0] * sin[..., None] + _CORNERS[:, 1] * cos[..., None]
    dx = x + (other[..., 0] - one[..., 0])[..., None]
    dy = y + (other[..., 1] - one[..., 1])[..., None]
    cos, sin = np.cos(one[..., 2])[..., None], np.sin(one[..., 2])[..., None]
    return np.stack([dx * cos + dy * sin, dy * cos - dx * sin], axis=-1)


def _distance(corners: np.ndarray) -> np.ndarray:
    """Distance (..., 4) of corners from the rectangle in whose frame they are."""
    return np.asarray(np.linalg.norm(np.maximum(np.abs(corners) - _HALF, 0.0), axis=-1))


def _beyond(corners: np.ndarray) -> np.ndarray:
    """(..., 2) whether all corners are beyond a side, along and across."""
    low, high = corners.min(axis=-2), corners.max(axis=-2)
    return np.asarray((low > _HALF) | (high < -_HALF))


@dataclass(frozen=True)
class CarsApart:
    """The circles around two cars do not overlap: 3.2 m between middles of halves.

    So cars in a lane are 5.7 m apart and cars side by side 3.2 m, while lanes are 4 m wide. The
    margin is ``(s - d^2) / (2 d)`` [m] with the distance d that circles need and a smooth minimum s
    of the four squared distances, which is smaller than all of them: by 8 % where two are equal.
    """

    players: tuple[int, int]  # whose cars
    first_step: int = 0  # from which on they keep apart
    more: float = 0.0  # distance between the circles [m]
    name: str = "cars apart"

    def margins(self, stage: Stage) -> ca.SX:
        one, other = (_middles(stage, player) for player in (0, 1))
        squares = [ca.sumsqr(a - b) + _LEAST for a, b in product(one, other)]
        powers = sum(square**-_SHARPNESS for square in squares)
        apart = 2 * _RADIUS + self.more
        return (powers ** (-1 / _SHARPNESS) - apart**2) / (2 * apart)


def _middles(stage: Stage, player: int) -> list[ca.SX]:
    """Middles (2,) of the front and the rear half of a car [m]."""
    heading = stage.states[player][stage.dynamics.state_names.index("heading")]
    ahead = _OFFSET * ca.vertcat(ca.cos(heading), ca.sin(heading))
    return [stage.position(player) + ahead, stage.position(player) - ahead]
