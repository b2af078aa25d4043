"""Gaps between cars, which are rectangles as in HighwayEnv's collisions."""

import numpy as np
from highway_env.vehicle.kinematics import Vehicle

_HALF = np.array([Vehicle.LENGTH, Vehicle.WIDTH]) / 2
_CORNERS = np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)]) * _HALF


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
    return np.linalg.norm(np.maximum(np.abs(corners) - _HALF, 0.0), axis=-1)


def _beyond(corners: np.ndarray) -> np.ndarray:
    """(..., 2) whether all corners are beyond a side, along and across."""
    low, high = corners.min(axis=-2), corners.max(axis=-2)
    return (low > _HALF) | (high < -_HALF)
