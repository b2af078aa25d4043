"""Lanes of a road as a map: their geometry, and which lane is near a car."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from olne_bench.games.model.lanes import ArcLane, Lane, SineLane, StraightLane
from olne_bench.visible import visible

DEFAULT_WIDTH = 4.0  # [m]
LONGEST_NAME = 200  # characters of a lane's or a player's name
FARTHEST = 1e9  # [m] from the origin; larger numbers are no metres
MOST_MAP_BYTES = 2**28  # of a file of a map
#: Bounds of a lane, far beyond real ones, so that its points can be computed.
_WIDEST, _SHORTEST, LONGEST = 1e3, 1e-6, 1e5  # [m]
_MOST_TURN = 100.0  # [rad]
_CURVES = 10  # by which a lane of several curves may be longer and turn more
_PAIRS = 2**20  # of positions and points that are compared at once
_UNIT = 1e-3  # tolerance of a direction's length
_ARC_STEP = np.deg2rad(2)  # [rad], largest angle between neighbouring points on an arc
_SAGITTA = 0.01  # [m], largest distance between an arc and the chord of neighbouring points
_SINE_STEP = 1.0  # [m] along the axis


@dataclass(frozen=True)
class RoadLane:
    """One lane: curves in driving order.

    Attributes:
        curves: curves of the centre line, at least one.
        width: width [m].
        following: names of the lanes that it leads to.
    """

    curves: tuple[Lane, ...]
    width: float = DEFAULT_WIDTH
    following: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Refuse lanes whose points cannot be computed.

        Raises:
            ValueError: with a message that names the number.
        """
        if not 0 < self.width <= _WIDEST:
            raise ValueError(f"a lane's width is {self.width:g} m, expected 0 to {_WIDEST:g}")
        for curve in self.curves:
            _check_curve(curve)
        length, turn = sum(curve.length for curve in self.curves), sum(map(_turn, self.curves))
        if length > _CURVES * LONGEST or turn > _CURVES * _MOST_TURN:
            raise ValueError(
                f"a lane of {length:g} m turns by {turn:g} rad, at most {_CURVES * LONGEST:g} m "
                f"and {_CURVES * _MOST_TURN:g} rad are expected"
            )

    @cached_property
    def line(self) -> np.ndarray:
        """Points (P, 2) of the centre line [m]."""
        parts = [curve_points(curve) for curve in self.curves]
        points = np.concatenate(parts)
        apart = np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-9
        return points[np.concatenate([[True], apart])]

    @property
    def length(self) -> float:
        """Length of the centre line [m]."""
        return float(np.linalg.norm(np.diff(self.line, axis=0), axis=1).sum())


def check_shown(what: str, name: str) -> None:
    """Refuse a name that is empty, long, or has characters that are not seen.

    Raises:
        ValueError: with a message that shows the name.
    """
    if not name.strip() or len(name) > LONGEST_NAME or visible(name) != name:
        raise ValueError(
            f"a {what} is called {name[:LONGEST_NAME]!r}; expected a name of 1 to {LONGEST_NAME} "
            "characters that can be seen"
        )


@dataclass(frozen=True)
class Road:
    """Lanes by name."""

    lanes: Mapping[str, RoadLane]

    def __post_init__(self) -> None:
        """Refuse names that cannot be shown.

        Raises:
            ValueError: with a message that shows the name.
        """
        for name in self.lanes:
            check_shown("lane", name)

    def near(self, positions: np.ndarray, within: float) -> "Road":
        """The lanes that pass within ``within`` [m] of any of the positions (S, 2)."""
        kept = {
            name: lane
            for name, lane in self.lanes.items()
            if locate(lane.line, positions).distance.min() < within
        }
        return Road(kept)


@dataclass(frozen=True)
class Place:
    """Positions relative to a line; every array is (S,).

    Attributes:
        along: distance along the line [m].
        distance: distance from the nearest point of the line [m].
        heading: heading of the line at this point [rad].
    """

    along: np.ndarray
    distance: np.ndarray
    heading: np.ndarray


def locate(line: np.ndarray, positions: np.ndarray) -> Place:
    """Project positions (S, 2) onto a line of points (P, 2)."""
    block = max(1, _PAIRS // len(line))
    starts = range(0, max(1, len(positions)), block)
    parts = [_located(line, positions[first : first + block]) for first in starts]
    if len(parts) == 1:
        return parts[0]
    along, distance, heading = (
        np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Place)
    )
    return Place(along, distance, heading)


def _located(line: np.ndarray, positions: np.ndarray) -> Place:
    start, step = line[:-1], np.diff(line, axis=0)
    length = np.linalg.norm(step, axis=1)
    unit = step / length[:, None]
    relative = positions[:, None] - start
    along = np.clip(np.einsum("spk,pk->sp", relative, unit), 0, length)
    distance = np.linalg.norm(relative - along[..., None] * unit, axis=-1)
    nearest = distance.argmin(axis=1)
    rows = np.arange(len(positions))
    before = np.concatenate([[0], np.cumsum(length)[:-1]])
    return Place(
        along=before[nearest] + along[rows, nearest],
        distance=distance[rows, nearest],
        heading=np.arctan2(unit[nearest, 1], unit[nearest, 0]),
    )


def curve_points(curve: Lane) -> np.ndarray:
    """Points (P, 2) on a curve of ``games.model.lanes``, from its start to its end.

    Raises:
        TypeError: on a curve of another kind.
    """
    if isinstance(curve, StraightLane):
        return _on_axis(curve, np.array([0.0, curve.length]))
    if isinstance(curve, SineLane):
        count = max(2, int(np.ceil(curve.length / _SINE_STEP)) + 1)
        along = np.linspace(0, curve.length, count)
        beside = curve.amplitude * np.sin(curve.pulsation * along + curve.phase)
        cos, sin = curve.axis.direction
        return _on_axis(curve.axis, along) + beside[:, None] * np.array([-sin, cos])
    if isinstance(curve, ArcLane):
        turn = _turn(curve)
        step = min(_ARC_STEP, np.sqrt(8 * _SAGITTA / curve.radius))
        count = max(2, int(np.ceil(turn / step)) + 1)
        phase = np.linspace(curve.start_phase, curve.end_phase, count)
        circle = np.column_stack([np.cos(phase), np.sin(phase)])
        return np.asarray(curve.centre) + curve.radius * circle
    raise TypeError(f"no points for a {type(curve).__name__}")


def _check_curve(curve: Lane) -> None:
    if not _SHORTEST <= curve.length <= LONGEST:
        raise ValueError(
            f"a lane's curve has a length of {curve.length:g} m, expected {_SHORTEST:g} to "
            f"{LONGEST:g}"
        )
    values: tuple[float, ...] = ()
    if isinstance(curve, StraightLane | SineLane):
        axis = curve if isinstance(curve, StraightLane) else curve.axis
        values = axis.start
        if not abs(np.hypot(*axis.direction) - 1) < _UNIT:
            x, y = axis.direction
            raise ValueError(f"a lane's direction ({x:g}, {y:g}) is not of length one")
    if isinstance(curve, SineLane):
        values += curve.amplitude, curve.pulsation, curve.phase
    if isinstance(curve, ArcLane):
        values = *curve.centre, curve.start_phase, curve.end_phase
        if _turn(curve) > _MOST_TURN:
            raise ValueError(
                f"an arc turns by {_turn(curve):g} rad, at most {_MOST_TURN:g} are expected"
            )
    if not np.abs(values).max() < FARTHEST:
        raise ValueError(f"a lane's curve has numbers beyond {FARTHEST:g}")


def _turn(curve: Lane) -> float:
    """Angle [rad] by which an arc turns; 0 for other curves, whose points do not depend on it."""
    return abs(curve.end_phase - curve.start_phase) if isinstance(curve, ArcLane) else 0.0


def _on_axis(axis: StraightLane, along: np.ndarray) -> np.ndarray:
    return np.asarray(axis.start) + along[:, None] * np.asarray(axis.direction)
