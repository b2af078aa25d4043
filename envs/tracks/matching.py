"""Which lanes a car drives on: the likeliest sequence, by position and heading.

A lane costs the squared distance [m] to it and how far the heading is off. Going on to a lane that
the present one leads to is free, changing to any other is dear, so noise does not look like a lane
change. The likeliest sequence is found by dynamic programming (Viterbi).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from olne_bench.envs.tracks.motion import Motion
from olne_bench.envs.tracks.road import Road, RoadLane, locate
from olne_bench.games.lanes import ArcLane, Lane, SineLane, StraightLane

HEADING_UNIT = 0.3  # [rad] that cost as much as a metre
CHANGE = 25.0  # cost of a lane change
_HOP = 0.1  # cost of going on, so that no lane is skipped for nothing
_MOST_HOPS = 4  # lanes ahead between two samples


@dataclass(frozen=True)
class Leg:
    """A stretch on one lane.

    Attributes:
        lane: its name.
        until: distance along the lane at which it was left [m].
        changed: whether the next leg's lane lies beside this one, rather than ahead of it.
    """

    lane: str
    until: float
    changed: bool


def driven(road: Road, motion: Motion) -> list[Leg]:
    """The lanes that a car was on, in order; lanes passed between two samples included."""
    names = list(road.lanes)
    seen = motion.seen
    positions, headings = motion.positions[seen], motion.headings[seen]
    places = [locate(road.lanes[name].line, positions) for name in names]
    off = np.stack([place.heading for place in places], axis=1) - headings[:, None]
    turned = np.where(np.isfinite(off), 2 * (1 - np.cos(off)) / HEADING_UNIT**2, 0.0)
    costs = np.stack([place.distance for place in places], axis=1) ** 2 + turned
    ways = _ways(road)
    step_cost = np.full((len(names), len(names)), CHANGE)
    for (a, b), between in ways.items():
        step_cost[names.index(a), names.index(b)] = _HOP * (len(between) + 1)
    np.fill_diagonal(step_cost, 0.0)
    best = _cheapest(costs, step_cost)
    legs: list[Leg] = []
    for k, lane in enumerate(best):
        end = k + 1 == len(best)
        if not end and best[k + 1] == lane:
            continue
        way = None if end else ways.get((names[lane], names[best[k + 1]]))
        legs.append(Leg(names[lane], float(places[lane].along[k]), not end and way is None))
        legs += [Leg(name, road.lanes[name].length, changed=False) for name in way or ()]
    return legs


def route(road: Road, legs: Sequence[Leg]) -> tuple[tuple[Lane, ...], list[str]]:
    """The curves that a car with these legs keeps to, and the names of their lanes.

    A car that changes lanes keeps to the lane that it ends in. One that comes back to its lane
    first keeps to the other until it left that.
    """
    curves: list[Lane] = []
    names: list[str] = []
    for group in _groups(legs):
        ends = [leg.lane for leg in group]
        earlier = [k for k, name in enumerate(ends[:-1]) if name == ends[-1]]
        for leg in group[earlier[-1] + 1 :] if earlier else group[-1:]:
            lane = road.lanes[leg.lane]
            for curve in _until(lane, leg.until) if leg.changed else lane.curves:
                _append(curves, curve)
            names.append(leg.lane)
    return tuple(curves), names


def _append(curves: list[Lane], curve: Lane) -> None:
    """Add a curve; one that goes on like the last is joined with it, as blending costs time."""
    last = curves[-1] if curves else None
    if isinstance(last, ArcLane) and isinstance(curve, ArcLane):
        turn = curve.end_phase - curve.start_phase
        on = np.sign(turn) == np.sign(last.end_phase - last.start_phase)
        if on and np.allclose([*last.centre, last.radius], [*curve.centre, curve.radius]):
            curves[-1] = replace(last, end_phase=last.end_phase + turn)
            return
    if isinstance(last, StraightLane) and isinstance(curve, StraightLane):
        end = np.asarray(last.start) + last.length * np.asarray(last.direction)
        if np.allclose(last.direction, curve.direction) and np.allclose(end, curve.start):
            curves[-1] = replace(last, length=last.length + curve.length)
            return
    curves.append(curve)


def _cheapest(costs: np.ndarray, step_cost: np.ndarray) -> list[int]:
    """The lanes, one per row of costs (S, L), of the cheapest sequence."""
    total, chosen = costs[0], []
    for row in costs[1:]:
        through = total[:, None] + step_cost
        chosen.append(through.argmin(axis=0))
        total = through.min(axis=0) + row
    best = [int(total.argmin())]
    for before in reversed(chosen):
        best.append(int(before[best[-1]]))
    return best[::-1]


def _ways(road: Road) -> dict[tuple[str, str], tuple[str, ...]]:
    """Which lanes lead to which, a few lanes ahead, and the lanes between."""
    result: dict[tuple[str, str], tuple[str, ...]] = {}
    for start in road.lanes:
        ahead: list[tuple[str, tuple[str, ...]]] = [(start, ())]
        for _ in range(_MOST_HOPS):
            following = []
            for name, between in ahead:
                for other in road.lanes[name].following:
                    if other in road.lanes and other != start and (start, other) not in result:
                        result[start, other] = between
                        following.append((other, (*between, other)))
            ahead = following
    return result


def _groups(legs: Sequence[Leg]) -> list[list[Leg]]:
    """Legs that lane changes connect."""
    groups: list[list[Leg]] = [[]]
    for leg in legs:
        groups[-1].append(leg)
        if not leg.changed:
            groups.append([])
    return [group for group in groups if group]


def _until(lane: RoadLane, along: float) -> list[Lane]:
    """The lane's curves up to a distance along it [m], with a metre at least."""
    kept: list[Lane] = []
    left = max(along, 1.0)
    for curve in lane.curves:
        if left <= 0:
            break
        kept.append(shortened(curve, min(left, curve.length)))
        left -= curve.length
    return kept


def shortened(curve: Lane, length: float) -> Lane:
    """The first metres of a curve.

    Raises:
        TypeError: on a curve of another kind than those of ``games.lanes``.
    """
    if isinstance(curve, StraightLane):
        return StraightLane(curve.start, curve.direction, length)
    if isinstance(curve, SineLane):
        axis = StraightLane(curve.axis.start, curve.axis.direction, length)
        return SineLane(axis, curve.amplitude, curve.pulsation, curve.phase)
    if isinstance(curve, ArcLane):
        turn = (curve.end_phase - curve.start_phase) * length / curve.length
        return ArcLane(curve.centre, curve.radius, curve.start_phase, curve.start_phase + turn)
    raise TypeError(f"no part of a {type(curve).__name__}")
