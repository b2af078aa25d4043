"""Fit straight lines and arcs to a centre line of points, as costs need lanes with curvature."""

from collections.abc import Sequence

import numpy as np

from olne_bench.envs.tracks.road import FARTHEST
from olne_bench.games.model.lanes import ArcLane, Lane, StraightLane

TOLERANCE = 0.1  # [m], largest distance between a curve and the points
MOST_POINTS = 10_000  # of a lane; more take minutes
_FLATTEST = 1e4  # [m]; an arc of a larger radius is a straight line


def curves_through(points: np.ndarray | Sequence[Sequence[float]]) -> tuple[Lane, ...]:
    """A few curves within ``TOLERANCE`` of points (P, 2), from the first to the last point.

    Each is the longest curve that fits: a straight line if one reaches as far as an arc.

    Raises:
        ValueError: if the points are not pairs of metres, too many, or fewer than two differ.
    """
    line = np.asarray(points, dtype=float)
    if line.ndim != 2 or line.shape[1] != 2 or not np.isfinite(line).all():
        raise ValueError("a lane's points are pairs of finite numbers")
    if len(line) > MOST_POINTS:
        raise ValueError(f"a lane has {len(line)} points, at most {MOST_POINTS} are expected")
    if (np.abs(line) > FARTHEST).any():
        raise ValueError(
            f"a lane has a point at {line.flat[np.abs(line).argmax()]:g}, beyond {FARTHEST:g} m"
        )
    line = line[np.r_[True, np.linalg.norm(np.diff(line, axis=0), axis=1) > 1e-6]]
    if len(line) < 2:
        raise ValueError("a lane needs at least two different points")
    curves: list[Lane] = []
    first = 0
    while first < len(line) - 1:
        last = _reach(line, first)
        curves.append(_best(line[first : last + 1]))
        first = last
    return tuple(curves)


def _reach(line: np.ndarray, first: int) -> int:
    """Index of the last point that one curve from ``first`` fits, by doubling and bisection."""
    good, step = first + 1, 1
    while good < len(line) - 1 and _fits(line[first : min(good + step, len(line) - 1) + 1]):
        good, step = min(good + step, len(line) - 1), 2 * step
    bad = min(good + step, len(line))
    while bad - good > 1:
        middle = (good + bad) // 2
        if _fits(line[first : middle + 1]):
            good = middle
        else:
            bad = middle
    return good


def _fits(points: np.ndarray) -> bool:
    straight, arc = _straight(points), _arc(points)
    return _error(straight, points) < TOLERANCE or (
        arc is not None and _error(arc, points) < TOLERANCE
    )


def _best(points: np.ndarray) -> Lane:
    straight, arc = _straight(points), _arc(points)
    if arc is None or _error(straight, points) < TOLERANCE:
        return straight
    return arc


def _straight(points: np.ndarray) -> StraightLane:
    step = points[-1] - points[0]
    length = max(float(np.linalg.norm(step)), 1e-9)
    return StraightLane(_pair(points[0]), _pair(step / length), length)


def _arc(points: np.ndarray) -> ArcLane | None:
    """The arc through the first, middle and last point; None if they are in line."""
    a, b, c = points[0], points[len(points) // 2], points[-1]
    (bx, by), (cx, cy) = b - a, c - a
    cross = bx * cy - by * cx
    size = max(np.abs(points - a).max(), 1e-9)
    if len(points) < 3 or abs(cross) < size**3 / _FLATTEST / 4:
        return None
    squares = bx**2 + by**2, cx**2 + cy**2
    centre = a + np.array(
        [cy * squares[0] - by * squares[1], bx * squares[1] - cx * squares[0]]
    ) / (2 * cross)
    radius = float(np.linalg.norm(a - centre))
    phases = np.unwrap(np.arctan2(*(points - centre).T[::-1]))
    if (np.diff(phases) * np.sign(cross) <= 0).any():
        return None
    return ArcLane(_pair(centre), radius, float(phases[0]), float(phases[-1]))


def _error(curve: StraightLane | ArcLane, points: np.ndarray) -> float:
    """Largest distance of the points and the midpoints between them from the curve [m]."""
    dense = np.concatenate([points, (points[1:] + points[:-1]) / 2])
    if isinstance(curve, ArcLane):
        return float(np.abs(np.linalg.norm(dense - curve.centre, axis=1) - curve.radius).max())
    dx, dy = (dense - curve.start).T
    cos, sin = curve.direction
    return float(np.abs(dy * cos - dx * sin).max())


def _pair(values: np.ndarray) -> tuple[float, float]:
    return float(values[0]), float(values[1])
