"""HighwayEnv's roads with the players on them.

The simulator is HighwayEnv's own: its environments, road networks, vehicles and ``step``. Only its
random traffic and its rewards are left out. Lane geometry is read from HighwayEnv's lane objects.
HighwayEnv's y axis points down in pictures.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from olne_bench.games.model.dynamics import bicycle
from olne_bench.games.model.lanes import ArcLane, Lane, SineLane, StraightLane

if TYPE_CHECKING:  # its import takes a second, and most that names a road needs none
    from highway_env.road.lane import AbstractLane
    from highway_env.road.road import LaneIndex, RoadNetwork

    from olne_bench.envs.roads.simulated_roads import PlayersOnly

SIMULATION_FREQUENCY = 15  # [Hz], HighwayEnv's default
SUB_STEPS = 6  # simulation frames per action
POLICY_FREQUENCY = SIMULATION_FREQUENCY / SUB_STEPS  # [Hz]
DT = 1 / POLICY_FREQUENCY  # [s], step of the games
LENGTH, MAX_SPEED = 5.0, 40.0  # [m], [m/s] of HighwayEnv's vehicles
#: HighwayEnv's vehicle as the motion model of a game.
CAR = bicycle(rear_axle=LENGTH / 2, sub_steps=SUB_STEPS)
#: Largest controls that the world accepts: steering [rad], acceleration [m/s^2].
MAX_STEERING = float(np.pi / 3)
MAX_ACCELERATION = 12.0


def lane_curve(lane: "AbstractLane") -> Lane:
    """One of HighwayEnv's lanes as a curve with the same parameters; ValueError for polylines."""
    from highway_env.road import lane as highway_lanes

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
    """The lanes with one more; an arc that continues the circle of the last one is joined to it."""
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


#: Names of the scenario families that are played in HighwayEnv.
ROAD_NAMES = ("highway", "intersection", "merge", "roundabout", "two_way")


def make_road(name: str, render_mode: str | None = None, **config: object) -> "PlayersOnly":
    """One of HighwayEnv's environments without vehicles, configured; ValueError on a wrong name."""
    if name not in ROAD_NAMES:
        raise ValueError(f"no road for {name!r}; known are: {', '.join(ROAD_NAMES)}")
    from olne_bench.envs.roads.simulated_roads import ROADS
    from olne_bench.envs.worlds.window import Window

    # In "human" mode HighwayEnv draws by itself, even before any vehicle is placed.
    rates = {"simulation_frequency": SIMULATION_FREQUENCY, "policy_frequency": POLICY_FREQUENCY}
    road = ROADS[name](config=rates | config, render_mode=render_mode and "rgb_array")
    if render_mode == "human":
        road.window = Window(name)
    return road


@lru_cache(maxsize=len(ROAD_NAMES))
def road_network(name: str) -> "RoadNetwork":
    """The road network of ``make_road(name)``."""
    return make_road(name).road.network


def route(network: "RoadNetwork", *indices: "LaneIndex") -> tuple[Lane, ...]:
    """The lanes with these indices as a route; arcs that continue each other become one."""
    lanes: list[Lane] = []
    for index in indices:
        lanes = appended(lanes, lane_curve(network.get_lane(index)))
    return tuple(lanes)


def replay(
    name: str, initial_state: np.ndarray, controls: np.ndarray, margin: float = 0.0
) -> np.ndarray:
    """States (T, N, 4) to which the simulator moves by open-loop controls (T-1, N, 2).

    The margin [m] is that of ``PlayersOnly.place``.
    """
    road = _replay_road(name)
    road.place(initial_state, margin)
    states = [road.states()]
    for control in controls:
        road.apply(control)
        states.append(road.states())
    return np.stack(states)


@lru_cache(maxsize=len(ROAD_NAMES))
def _replay_road(name: str) -> "PlayersOnly":
    return make_road(name)
