"""Lanes of a road as a map: their geometry, which lane is near a car, and lanes through points."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from olne_bench.errors import MALFORMED, UserError, reason
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
TOLERANCE = 0.1  # [m], largest distance between a curve and the points
MOST_POINTS = 10_000  # of a lane; more take minutes
_FLATTEST = 1e4  # [m]; an arc of a larger radius is a straight line


@dataclass(frozen=True)
class RoadLane:
    """One lane: curves in driving order."""

    curves: tuple[Lane, ...]  # curves of the centre line, at least one
    width: float = DEFAULT_WIDTH  # width [m]
    following: tuple[str, ...] = ()  # names of the lanes that it leads to

    def __post_init__(self) -> None:
        """ValueError for lanes whose points cannot be computed."""
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
        points = np.concatenate([curve_points(curve) for curve in self.curves])
        return _apart(points, 1e-9)

    @property
    def length(self) -> float:
        """Length of the centre line [m]."""
        return float(np.linalg.norm(np.diff(self.line, axis=0), axis=1).sum())


def _apart(points: np.ndarray, least: float) -> np.ndarray:
    """Points (P, 2) without those that are nearly [m] the ones before them."""
    return points[np.r_[True, np.linalg.norm(np.diff(points, axis=0), axis=1) > least]]


def check_shown(what: str, name: str) -> None:
    """ValueError for a name that is empty, long, or has characters that are not seen."""
    if not name.strip() or len(name) > LONGEST_NAME or visible(name) != name:
        raise ValueError(
            f"a {what} is called {name[:LONGEST_NAME]!r}; expected a name of 1 to {LONGEST_NAME} "
            "characters that can be seen"
        )


@dataclass(frozen=True)
class Road:
    """Lanes by name."""

    lanes: Mapping[str, RoadLane]
    notes: tuple[str, ...] = field(default=(), compare=False)  # what of a map was left out

    def __post_init__(self) -> None:
        """ValueError for names that cannot be shown."""
        for name in self.lanes:
            check_shown("lane", name)

    def near(self, positions: np.ndarray, within: float) -> "Road":
        """Lanes that pass within ``within`` [m] of any position (S, 2), and those they lead to."""
        far = {n: locate(lane.line, positions).distance.min() for n, lane in self.lanes.items()}
        near = {name for name in self.lanes if far[name] < within}
        ahead = {after for name in near for after in self.lanes[name].following}
        return Road(
            {name: lane for name, lane in self.lanes.items() if name in near | ahead}, self.notes
        )


_LEFT_OUT = "left out: "
#: What reading a lane, or another element of a file, raises on one that is wrong.
UNREADABLE: tuple[type[Exception], ...] = (*MALFORMED, AttributeError, TypeError, UserError)


def read_lanes(following: Mapping[str, Sequence[str]], lane: Callable[[str], RoadLane]) -> Road:
    """The lanes of a map, with a note on those that cannot be read.

    ``following`` has the names of all lanes and of those that each leads to; ``lane`` reads one.
    A lane that leads to one that cannot be read leads to those after it.
    """
    lanes, wrong = {}, {}
    for name in following:
        try:
            lanes[name] = lane(name)
        except UNREADABLE as error:
            wrong[name] = reason(error)
    lanes = {
        name: replace(one, following=tuple(_beyond(following, following[name], wrong)))
        for name, one in lanes.items()
    }
    return Road(lanes, left_out([f"lane {name!r}: {why}" for name, why in wrong.items()]))


def with_lanes(road: Road) -> Road:
    """The road; ValueError, with the first reason, if all of its lanes were left out."""
    if road.notes and not road.lanes:
        raise ValueError(road.notes[0].removeprefix(_LEFT_OUT))
    return road


def left_out(wrong: Sequence[str]) -> tuple[str, ...]:
    """A note on the first of those that are left out, if any are."""
    more = f", and {len(wrong) - 1} more" if len(wrong) > 1 else ""
    return (f"{_LEFT_OUT}{wrong[0]}{more}",) if wrong else ()


def _beyond(
    following: Mapping[str, Sequence[str]], names: Sequence[str], wrong: Mapping[str, str]
) -> dict[str, None]:
    """The names, with those after a wrong lane in place of it."""
    found: dict[str, None] = {}
    ahead, passed = list(names), set()
    while ahead:
        name = ahead.pop(0)
        if name not in wrong:
            found[name] = None
        elif name not in passed:
            passed.add(name)
            ahead = [*following.get(name, ()), *ahead]
    return found


@dataclass(frozen=True)
class Place:
    """Positions relative to a line; every array is (S,)."""

    along: np.ndarray  # distance along the line [m]
    distance: np.ndarray  # distance from the nearest point of the line [m]
    heading: np.ndarray  # heading of the line at this point [rad]


def locate(line: np.ndarray, positions: np.ndarray) -> Place:
    """Project positions (S, 2) onto a line of points (P, 2)."""
    block = max(1, _PAIRS // len(line))
    starts = range(0, max(1, len(positions)), block)
    parts = [_located(line, positions[first : first + block]) for first in starts]
    return Place(*map(np.concatenate, zip(*parts, strict=True)))


def _located(line: np.ndarray, positions: np.ndarray) -> tuple[np.ndarray, ...]:
    start, step = line[:-1], np.diff(line, axis=0)
    length = np.linalg.norm(step, axis=1)
    unit = step / length[:, None]
    relative = positions[:, None] - start
    along = np.clip(np.einsum("spk,pk->sp", relative, unit), 0, length)
    distance = np.linalg.norm(relative - along[..., None] * unit, axis=-1)
    nearest = distance.argmin(axis=1)
    rows = np.arange(len(positions))
    before = np.concatenate([[0], np.cumsum(length)[:-1]])
    return (
        before[nearest] + along[rows, nearest],
        distance[rows, nearest],
        np.arctan2(unit[nearest, 1], unit[nearest, 0]),
    )


def curve_points(curve: Lane) -> np.ndarray:
    """Points (P, 2) on a curve of ``games.model.lanes``, from its start to its end."""
    if isinstance(curve, StraightLane):
        return _on_axis(curve, np.array([0.0, curve.length]))
    if isinstance(curve, SineLane):
        count = max(2, int(np.ceil(curve.length / _SINE_STEP)) + 1)
        along = np.linspace(0, curve.length, count)
        beside = curve.amplitude * np.sin(curve.pulsation * along + curve.phase)
        cos, sin = curve.axis.direction
        return np.asarray(_on_axis(curve.axis, along) + beside[:, None] * np.array([-sin, cos]))
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
    return np.asarray(np.asarray(axis.start) + along[:, None] * np.asarray(axis.direction))


def curves_through(points: np.ndarray | Sequence[Sequence[float]]) -> tuple[Lane, ...]:
    """A few curves within ``TOLERANCE`` of points (P, 2), from the first to the last point.

    Each is the longest curve that fits: a straight line if one reaches as far as an arc. ValueError
    if the points are not pairs of metres, too many, or fewer than two differ.
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
    line = _apart(line, 1e-6)
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
    return _error(_best(points), points) < TOLERANCE


def _best(points: np.ndarray) -> StraightLane | ArcLane:
    straight, arc = _straight(points), _arc(points)
    return straight if arc is None or _error(straight, points) < TOLERANCE else arc


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
