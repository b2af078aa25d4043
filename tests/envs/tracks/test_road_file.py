"""TOML files of lanes and targets: read, written, refused."""

from pathlib import Path

import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.scenarios.merge import Merge
from olne_bench.envs.tracks.road_file import (
    RoadFile,
    highway_road,
    read_road_file,
    road_file,
    route_curves,
    write_road_file,
)
from olne_bench.errors import UserError
from olne_bench.games.model.lanes import LaneKeeping, StraightLane


def test_a_scenario_comes_back_from_its_file(tmp_path: Path) -> None:
    scenario = Merge().propose(np.random.default_rng(0), 3)
    path = tmp_path / "merge.toml"
    write_road_file(path, road_file(scenario))
    known = read_road_file(path)
    assert known == road_file(scenario)
    assert known.scenario == "merge"
    for name, player in zip(known.players, scenario.game.players, strict=True):
        entry = known.players[name]
        (keeping,) = [term for term in player.task if isinstance(term, LaneKeeping)]
        assert entry.lanes is not None
        assert route_curves(known.lanes, entry.lanes) == keeping.route
        assert entry.blend == keeping.blend
        assert entry.targets["speed"] == player.preferences[1].target  # type: ignore[attr-defined]


def test_goals_are_in_the_file() -> None:
    known = road_file(get_scenario("two_player"))
    assert known.players["player_0"].goal == (1.0, 0.0)
    assert known.road() is None


def test_lanes_of_a_road_lead_to_each_other() -> None:
    road = highway_road("intersection")
    assert "ir0_il1_0" in road.lanes["o0_ir0_0"].following
    assert road.lanes["il1_o1_0"].following == ()


def test_lanes_may_be_points(tmp_path: Path) -> None:
    path = tmp_path / "road.toml"
    path.write_text("[lanes.a]\npoints = [[0, 0], [50, 0], [100, 0]]\nwidth = 3\n")
    road = read_road_file(path).road()
    assert road is not None
    assert road.lanes["a"].curves == (StraightLane((0.0, 0.0), (1.0, 0.0), 100.0),)
    assert road.lanes["a"].width == 3


REFUSED = {
    "not TOML": ("lanes = [", "is not a TOML file"),
    "unknown": ("[lane.a]\n", "lane: Extra inputs are not permitted"),
    "neither": ("[lanes.a]\nwidth = 3\n", "lanes.a: a lane has either points or curves"),
    "one point": (
        "[lanes.a]\npoints = [[0, 0]]\n",
        "lanes.a: a lane needs at least two different points",
    ),
    "no lane": (
        '[lanes.a]\npoints = [[0, 0], [1, 0]]\n[players.p]\nlanes = ["b"]\n',
        "player 'p' names the lane 'b'; there are: a",
    ),
    "no successor": (
        '[lanes.a]\npoints = [[0, 0], [1, 0]]\nfollowing = ["c"]\n',
        "lane 'a' names the lane 'c'; there are: a",
    ),
    "width": (
        "[lanes.a]\npoints = [[0, 0], [1, 0]]\nwidth = 0\n",
        "lanes.a.width: Input should be greater than 0",
    ),
    "infinite": (
        "[players.p]\ntargets = { speed = inf }\n",
        "players.p.targets.speed: Input should be a finite number",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_wrong_is_named(case: str, tmp_path: Path) -> None:
    text, words = REFUSED[case]
    path = tmp_path / "road.toml"
    path.write_text(text)
    with pytest.raises(UserError) as caught:
        read_road_file(path)
    assert words in str(caught.value)
    assert str(caught.value).startswith(str(path))


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no road file"):
        read_road_file(tmp_path / "road.toml")


def test_lanes_of_a_map_may_be_named_before_it_is_known() -> None:
    known = RoadFile.model_validate({"players": {"p": {"lanes": ["of the map"]}}})
    with pytest.raises(ValueError, match="there are: none"):
        known.check_lanes()
