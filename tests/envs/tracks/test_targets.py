"""Targets of one player: from the file, else the draw, else the scenario, else the track."""

from dataclasses import replace

import numpy as np
import pytest

from olne_bench.envs.tracks.explained import Known, Targets, check_told
from olne_bench.envs.tracks.grid import Motion
from olne_bench.envs.tracks.road import Road, RoadLane
from olne_bench.envs.tracks.road_file import RoadFile
from olne_bench.errors import UserError
from olne_bench.games.model.costs import ControlEffort, FinalGoal, Proximity, StateDeviation
from olne_bench.games.model.game import Player
from olne_bench.games.model.lanes import LaneKeeping, StraightLane

EAST = StraightLane((0.0, 0.0), (1.0, 0.0), 100.0)
NORTH = StraightLane((100.0, 0.0), (0.0, 1.0), 100.0)
ROAD = Road({"east": RoadLane((EAST,)), "north": RoadLane((NORTH,))})


def driving(speed: float, blend: float = 2.0, px: float = 0.0) -> Player:
    return Player(
        (Proximity(), StateDeviation("speed", speed, scale=0.5), ControlEffort("acceleration")),
        (StateDeviation("px", px), LaneKeeping((EAST,), width=3.0, blend=blend)),
    )


def motion(last_x: float = 20.0, gap: bool = True) -> Motion:
    """Eastward, faster and faster; the last sample is missing."""
    x = np.array([0.0, 4.0, 10.0, last_x, np.nan])[: 5 if gap else 4]
    count = len(x)
    heading, speed = np.full(count, 0.1), np.array([7.0, 8.0, 9.0, 30.0, np.nan])[:count]
    return Motion(np.column_stack([x, 0.5 + 0 * x]), heading, speed)


def targets(
    players: list[Player],
    told: dict[str, object] | None = None,
    drawn: Player | None = None,
    seen: Motion | None = None,
) -> Targets:
    lanes = {name: {"points": [[0, 10 * k], [99, 10 * k]]} for k, name in enumerate("ab")}
    content = {"lanes": lanes, "players": {"car": told} if told else {}}
    known = Known(RoadFile.model_validate(content), ROAD, players)
    return Targets("car", seen or motion(), known, drawn)


def sources(found: Targets) -> dict[str, tuple[str, str, str]]:
    return {one.what: (one.value, one.source, one.how) for one in found.assumptions}


def test_the_file_comes_first() -> None:
    told: dict[str, object] = {"targets": {"speed": 12.5, "px": 3.0}, "lanes": ["b"], "blend": 7.0}
    found = targets([driving(9.0)], told, drawn=driving(9.0))
    costs = found.applied(driving(9.0))
    assert costs.preferences == (
        Proximity(),
        StateDeviation("speed", 12.5, scale=0.5),
        ControlEffort("acceleration"),
    )
    place, keeping = costs.task
    assert place == StateDeviation("px", 3.0)
    assert keeping == LaneKeeping(
        (StraightLane((0.0, 10.0), (1.0, 0.0), 99.0),), width=3.0, blend=7.0
    )
    assert sources(found) == {
        "speed": ("12.5", "file", ""),
        "px": ("3", "file", ""),
        "lanes": ("b", "file", ""),
    }


def test_then_the_draw_with_its_costs_as_they_are() -> None:
    drawn = driving(9.0, blend=5.0)
    drawn = replace(drawn, task=(*drawn.task, FinalGoal((4.0, 5.0))))
    found = targets([driving(7.0), drawn], drawn=drawn)
    assert found.applied(drawn) == drawn
    assert {one.source for one in found.assumptions} == {"draw"}
    assert sources(found)["lanes"][0] == "1 lane"
    assert sources(found)["goal"][0] == "(4, 5)"
    two = replace(drawn, task=(LaneKeeping((EAST, NORTH)),))
    found = targets([two], drawn=two)
    found.applied(two)
    assert sources(found)["lanes"][0] == "2 lanes"


def test_then_the_scenario_where_all_its_players_agree() -> None:
    found = targets([driving(9.0), driving(9.0)])
    assert found.applied(driving(9.0)).preferences[1] == StateDeviation("speed", 9.0, scale=0.5)
    assert sources(found)["speed"] == ("9", "scenario", "")


def test_then_the_track() -> None:
    players = [driving(9.0, blend=2.0, px=0.0), driving(8.0, blend=6.0, px=40.0)]
    players[1] = replace(players[1], task=(*players[1].task, FinalGoal((0.0, 0.0))))
    found = targets(players)
    costs = found.applied(players[1])
    assert costs.preferences[1] == StateDeviation("speed", 8.5, scale=0.5)  # of what is known
    place, keeping, goal = costs.task
    assert place == StateDeviation("px", 20.0)
    assert isinstance(goal, FinalGoal) and goal.goal == (20.0, 0.5)
    assert isinstance(keeping, LaneKeeping)
    assert (keeping.route, keeping.blend, keeping.width) == ((EAST,), 6.0, 3.0)
    assert sources(found) == {
        "speed": ("8.5", "data", "median speed"),
        "px": ("20", "data", "where it was last seen"),
        "lanes": ("east", "data", "the lanes driven, by position and heading"),
        "goal": ("(20, 0.5)", "data", "where it was last seen"),
    }


@pytest.mark.parametrize(
    ("last", "target"), [(19.9, 0.0), (20.1, 40.0), (-19.9, 0.0), (-20.1, -20.1), (60.1, 60.1)]
)
def test_a_lane_of_the_scenario_is_kept_within_half_a_lane(last: float, target: float) -> None:
    players = [driving(9.0, px=0.0), driving(9.0, px=40.0), driving(9.0, px=140.0)]
    found = targets(players, seen=motion(last))
    assert found.applied(players[0]).task[0] == StateDeviation("px", target)
    how = sources(found)["px"][2]
    assert how.startswith("where" if target == last else "the scenario's lane nearest")


def test_what_no_track_tells_is_asked_for() -> None:
    players = [Player((StateDeviation("yaw", k),), ()) for k in (0.0, 1.0)]
    with pytest.raises(UserError, match="the target of 'yaw' of player 'car' is unknown"):
        targets(players).applied(players[0])
    unseen = motion()
    unseen.speeds[:] = np.nan
    with pytest.raises(UserError, match="the target of 'speed' of player 'car' is unknown"):
        targets([driving(1.0), driving(2.0)], seen=unseen).applied(driving(1.0))
    turned = [Player((StateDeviation("heading", k),), ()) for k in (0.0, 1.0)]
    costs = targets(turned).applied(turned[0])
    assert costs.preferences[0] == StateDeviation("heading", 0.1)


def test_what_the_costs_make_no_use_of_is_told() -> None:
    def told(entry: dict[str, object], *players: Player) -> list[str]:
        lanes = {"a": {"points": [[0, 0], [9, 0]]}}
        content = {"lanes": lanes, "players": {"car": entry}}
        return check_told("moon", Known(RoadFile.model_validate(content), None, players))

    aimed = Player((StateDeviation("speed", 1.0),), (FinalGoal((0.0, 0.0)),))
    assert told({"targets": {"speed": 2.0}, "goal": [1, 2]}, aimed) == []
    assert told({"lanes": ["a"]}, driving(1.0)) == told({"lanes": ["a"]}, aimed, driving(1.0)) == []
    unused = "of player 'car': not used, 'moon' has no such cost"
    assert told({"lanes": ["a"], "goal": [1, 2]}, aimed) == [f"lanes {unused}"]
    assert told({"goal": [1, 2]}, driving(1.0)) == [f"goal {unused}"]
    with pytest.raises(
        UserError, match="target of 'sped' for player 'car'; costs of 'moon' have: speed"
    ):
        told({"targets": {"sped": 2.0}}, aimed)
    with pytest.raises(UserError, match="costs of 'moon' have: none"):
        told({"targets": {"speed": 2.0}}, Player((Proximity(),), ()))
