"""Match cars to lanes: the likeliest sequence, by position and heading, and whether they are on it.

The cost of a lane is the squared distance [m] to it and the deviation from its heading. A
transition to a lane that the present one leads to is almost free, any other expensive. The cheapest
sequence is found by dynamic programming (Viterbi).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from olne_bench.envs.tracks.grid import Motion
from olne_bench.envs.tracks.road import Road, RoadLane, locate
from olne_bench.errors import UserError, bad_input
from olne_bench.games.model.game import Player
from olne_bench.games.model.lanes import ArcLane, Lane, LaneKeeping, SineLane, StraightLane

HEADING_UNIT = 0.3  # [rad], heading deviation that costs as much as a metre
CHANGE = 25.0  # cost of a lane change
_HOP = 0.1  # cost of a transition to a following lane, so that none is skipped needlessly
_MOST_HOPS = 4  # largest number of transitions between two samples
MARGIN = 1.0  # [m], largest distance beside a lane
TOLERATED = 0.2  # share of a car's samples that may be off the road, or against the lanes
_FAR = 1e4  # [m]
_HINT = (
    "'olne-bench import' changes the frame by --shift, --flip-y and --rotate, selects players by "
    "--players, and takes other lanes by --road"
)


@dataclass(frozen=True)
class Leg:
    """A part of a car's way, on one lane."""

    lane: str
    until: float  # distance along the lane at which the car left it [m]
    changed: bool  # whether the car changed to the next leg's lane, instead of following this one


def driven(road: Road, motion: Motion) -> list[Leg]:
    """The lanes that a car was on, in order, including lanes passed between two samples."""
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
    """The curves and names of the lanes that a car with these legs keeps to.

    That is the lane in which it ends, but, for one that returns to it, the other until it leaves
    that.
    """
    curves: list[Lane] = []
    names: list[str] = []
    starts = [0, *(k + 1 for k, leg in enumerate(legs) if not leg.changed), len(legs)]
    for first, after in pairwise(starts):  # legs that are connected by lane changes
        group = legs[first:after]
        if not group:
            continue
        ends = [leg.lane for leg in group]
        earlier = [k for k, name in enumerate(ends[:-1]) if name == ends[-1]]
        for leg in group[earlier[-1] + 1 :] if earlier else group[-1:]:
            lane = road.lanes[leg.lane]
            for curve in _until(lane, leg.until) if leg.changed else lane.curves:
                _append(curves, curve)
            names.append(leg.lane)
    return tuple(curves), names


def _append(curves: list[Lane], curve: Lane) -> None:
    """Add a curve; a curve that continues the last one is joined with it, as blending is slow."""
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
    """The cheapest sequence of lanes, one index per row of costs (S, L)."""
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
    """Pairs of lanes of which one leads to the other in a few transitions, and those between."""
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


def _until(lane: RoadLane, along: float) -> list[Lane]:
    """The lane's curves up to a distance along it [m], at least one metre."""
    kept: list[Lane] = []
    left = max(along, 1.0)
    for curve in lane.curves:
        if left <= 0:
            break
        kept.append(shortened(curve, min(left, curve.length)))
        left -= curve.length
    return kept


def shortened(curve: Lane, length: float) -> Lane:
    """The first ``length`` metres of a curve."""
    if isinstance(curve, StraightLane):
        return replace(curve, length=length)
    if isinstance(curve, SineLane):
        return replace(curve, axis=replace(curve.axis, length=length))
    if isinstance(curve, ArcLane):
        turn = (curve.end_phase - curve.start_phase) * length / curve.length
        return replace(curve, end_phase=curve.start_phase + turn)
    raise TypeError(f"no part of a {type(curve).__name__}")


def check_on_road(
    road: Road, names: Sequence[str], motions: Sequence[Motion], noise: float
) -> None:
    """UserError on players that are off the road, or drive against its lanes."""
    for name, motion in zip(names, motions, strict=True):
        positions, headings = motion.positions[motion.seen], motion.headings[motion.seen]
        places = [locate(lane.line, positions) for lane in road.lanes.values()]
        distance = np.stack([place.distance for place in places])
        widths = np.array([lane.width for lane in road.lanes.values()])
        on_lane = distance < (widths / 2 + MARGIN + 2 * noise)[:, None]
        off_road = ~on_lane.any(axis=0)
        if off_road.mean() > TOLERATED:
            k = int(distance.min(axis=0).argmax())
            x, y = positions[k]
            raise UserError(
                f"player {name!r} is off the road: at ({x:.1f}, {y:.1f}) the nearest lane is "
                f"{distance.min(axis=0)[k]:.1f} m away, and it is off the road in "
                f"{off_road.mean():.0%} of its samples; {_HINT}"
            )
        ahead = np.cos(np.stack([place.heading for place in places]) - headings)
        against = np.where(on_lane, ahead, -np.inf).max(axis=0) < 0
        told = np.isfinite(headings) & ~off_road
        if told.any() and against[told].mean() > TOLERATED:
            k = int(np.flatnonzero(against & told)[0])
            x, y = positions[k]
            raise UserError(
                f"player {name!r} drives against the lanes: at ({x:.1f}, {y:.1f}) it heads "
                f"{np.rad2deg(headings[k]):.0f} degrees, and so in {against[told].mean():.0%} of "
                f"its samples; {_HINT}"
            )


def lane_warnings(
    names: Sequence[str], motions: Sequence[Motion], players: Sequence[Player], noise: float
) -> list[str]:
    """Warnings on players that end beside the lanes they are assumed to keep."""
    warnings = []
    for name, motion, player in zip(names, motions, players, strict=True):
        last = motion.positions[motion.seen][-1:]
        for term in player.task:
            if not isinstance(term, LaneKeeping):
                continue
            with bad_input(f"the lanes of player {name!r}"):
                lane = RoadLane(term.route)
            onward = lane.line[-1] - lane.line[-2]
            end = lane.line[-1] + _FAR * onward / np.linalg.norm(onward)
            # The last lane of a route has no end.
            beside = float(locate(np.vstack([lane.line, end]), last).distance[0])
            if beside > lane.width / 2 + MARGIN + 2 * noise:
                warnings.append(
                    f"player {name!r} ends {beside:.1f} m beside the lanes it is assumed to keep"
                )
    return warnings
