"""The road and the players' targets of a scenario, as plain data."""

from functools import lru_cache
from itertools import count

from olne_bench.envs.highway_roads import ROAD_NAMES, road_network
from olne_bench.envs.lane_curves import lane_curve
from olne_bench.envs.layout import player_name
from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.envs.tracks.road import Road, RoadLane
from olne_bench.envs.tracks.road_file import (
    LaneEntry,
    PlayerEntry,
    RoadFile,
    curve_entry,
    lane_entries,
)
from olne_bench.games.features import FinalGoal, StateDeviation
from olne_bench.games.game import Player
from olne_bench.games.lanes import Lane, LaneKeeping


def road_of_scenario(scenario: Scenario) -> Road | None:
    """The lanes of the HighwayEnv road that a scenario is played on; None elsewhere."""
    if scenario.world != "highway_v0" or scenario.name not in ROAD_NAMES:
        return None
    return highway_road(scenario.name)


@lru_cache(maxsize=len(ROAD_NAMES))
def highway_road(name: str) -> Road:
    """All lanes of one of HighwayEnv's roads; ``a_b_0`` is the first lane from node a to b."""
    graph = road_network(name).graph
    lanes = {}
    for start, ends in graph.items():
        for end, parallel in ends.items():
            following = tuple(
                f"{end}_{after}_{number}"
                for after, others in graph.get(end, {}).items()
                for number in range(len(others))
                if after != start or end not in graph.get(start, {})
            )
            for number, lane in enumerate(parallel):
                curve = lane_curve(lane)
                lanes[f"{start}_{end}_{number}"] = RoadLane((curve,), float(lane.width), following)
    return Road(lanes)


def road_file(scenario: Scenario) -> RoadFile:
    """What is known of a scenario's players besides their weights.

    Routes over lanes of a kind that has no plain numbers are left out.
    """
    road = road_of_scenario(scenario)
    lanes = lane_entries(road) if road else {}
    players = {
        player_name(index): _player(player, player_name(index), lanes)
        for index, player in enumerate(scenario.game.players)
    }
    return RoadFile(scenario=scenario.name, lanes=lanes, players=players)


def _player(player: Player, name: str, lanes: dict[str, LaneEntry]) -> PlayerEntry:
    """The player's targets; lanes that its route has for itself join ``lanes``."""
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
    """The name of a lane with exactly that curve, a new one where there is none."""
    entry = curve_entry(curve)
    for name, lane in lanes.items():
        if lane.curves == [entry]:
            return name
    new = next(name for k in count() if (name := f"{player}_lane_{k}") not in lanes)
    lanes[new] = LaneEntry(curves=[entry])
    return new
