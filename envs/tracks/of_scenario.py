"""The road and the players' targets of a scenario, as plain data."""

from dataclasses import replace
from functools import lru_cache
from itertools import count

import numpy as np

from olne_bench.envs.roads.highway_roads import ROAD_NAMES, lane_curve, road_network
from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.envs.tracks.road import Road, RoadLane
from olne_bench.envs.tracks.road_file import (
    LaneEntry,
    PlayerEntry,
    RoadFile,
    curve_entry,
    lane_entries,
)
from olne_bench.envs.worlds.layout import player_name
from olne_bench.games.model.costs import FinalGoal, StateDeviation
from olne_bench.games.model.game import Player
from olne_bench.games.model.lanes import Lane, LaneKeeping

_BESIDE = 1.5  # largest gap between a lane's end and a following lane, in lane widths


def road_of_scenario(scenario: Scenario) -> Road | None:
    """The lanes of a scenario's HighwayEnv road; None if it is not on one."""
    if scenario.world != "highway_v0" or scenario.name not in ROAD_NAMES:
        return None
    return highway_road(scenario.name)


@lru_cache(maxsize=len(ROAD_NAMES))
def highway_road(name: str) -> Road:
    """All lanes of one of HighwayEnv's roads; ``a_b_0`` is the first lane from node a to b."""
    lanes = {
        (start, end, number): RoadLane((lane_curve(lane),), float(lane.width))
        for start, ends in road_network(name).graph.items()
        for end, parallel in ends.items()
        for number, lane in enumerate(parallel)
    }
    return Road(
        {
            _name(index): replace(
                lane,
                following=tuple(
                    _name(other)
                    for other, after in lanes.items()
                    if other[0] == index[1] and _goes_on(lane, after)
                ),
            )
            for index, lane in lanes.items()
        }
    )


def _name(index: tuple[str, str, int]) -> str:
    return "_".join(map(str, index))


def _goes_on(lane: RoadLane, after: RoadLane) -> bool:
    """Whether a car at the end of a lane can continue on another one, ahead or beside it."""
    gap = after.line[0] - lane.line[-1]
    turn = (after.line[1] - after.line[0]) @ (lane.line[-1] - lane.line[-2])
    return bool(turn > 0 and np.linalg.norm(gap) < _BESIDE * lane.width)


def road_file(scenario: Scenario) -> RoadFile:
    """The road and the targets of a scenario's players, without their weights.

    Routes over lanes that cannot be written as plain numbers are left out.
    """
    road = road_of_scenario(scenario)
    lanes = lane_entries(road) if road else {}
    players = {
        player_name(index): _player(player, player_name(index), lanes)
        for index, player in enumerate(scenario.game.players)
    }
    return RoadFile(scenario=scenario.name, lanes=lanes, players=players)


def _player(player: Player, name: str, lanes: dict[str, LaneEntry]) -> PlayerEntry:
    """The player's targets; lanes that only its route has are added to ``lanes``."""
    terms = (*player.preferences, *player.task)
    goals = [term.goal for term in terms if isinstance(term, FinalGoal)]
    routes = [term for term in terms if isinstance(term, LaneKeeping)]
    entry = PlayerEntry(
        targets={t.component: float(t.target) for t in terms if isinstance(t, StateDeviation)},
        goal=goals[0] if goals else None,
    )
    if not routes:
        return entry
    try:
        names = [_named(curve, name, lanes) for curve in routes[0].route]
    except TypeError:
        return entry
    return entry.model_copy(update={"lanes": names, "blend": float(routes[0].blend)})


def _named(curve: Lane, player: str, lanes: dict[str, LaneEntry]) -> str:
    """The name of the lane with exactly this curve, which is added if there is none."""
    entry = curve_entry(curve)
    for name, lane in lanes.items():
        if lane.curves == [entry]:
            return name
    new = next(name for k in count() if (name := f"{player}_lane_{k}") not in lanes)
    lanes[new] = LaneEntry(curves=[entry])
    return new
