"""HighwayEnv's lanes as curves that a game can use."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from highway_env.road import lane as highway_lanes

from olne_bench.games.model.lanes import ArcLane, Lane, SineLane, StraightLane


def lane_curve(lane: highway_lanes.AbstractLane) -> Lane:
    """One of HighwayEnv's lanes as a curve of ``games.model.lanes`` with the same parameters.

    Raises:
        ValueError: for a kind of lane that has no such curve (polylines).
    """
    if isinstance(lane, highway_lanes.StraightLane):  # a SineLane is one as well
        axis = StraightLane(_pair(lane.start), _pair(lane.direction), float(lane.length))
        if not isinstance(lane, highway_lanes.SineLane):
            return axis
        return SineLane(axis, float(lane.amplitude), float(lane.pulsation), float(lane.phase))
    if isinstance(lane, highway_lanes.CircularLane):
        start = float(lane.start_phase)
        end = start + lane.direction * float(lane.length) / lane.radius
        return ArcLane(_pair(lane.center), float(lane.radius), start, end)
    raise ValueError(
        f"no curve for a {type(lane).__name__}; known are: StraightLane, SineLane, CircularLane"
    )


def appended(lanes: list[Lane], lane: Lane) -> list[Lane]:
    """The lanes with one more at the end.

    An arc that continues the circle of the last lane is joined with it.
    """
    last = lanes[-1] if lanes else None
    if (
        isinstance(last, ArcLane)
        and isinstance(lane, ArcLane)
        and (last.centre, last.radius) == (lane.centre, lane.radius)
    ):
        turn = lane.end_phase - lane.start_phase
        return [*lanes[:-1], replace(last, end_phase=last.end_phase + turn)]
    return [*lanes, lane]


def _pair(values: Sequence[float] | np.ndarray) -> tuple[float, float]:
    return float(values[0]), float(values[1])
