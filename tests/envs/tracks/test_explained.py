"""Recordings are explained by a scenario's costs; targets have sources."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import CubicSpline

from olne_bench.envs.recordings.recording import Recording
from olne_bench.envs.recordings.recording_file import RecordingFile, of_recordings
from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.tracks import explained as module
from olne_bench.envs.tracks.explained import Known, Targets, check_told, explain
from olne_bench.envs.tracks.export import Episode, write_csv
from olne_bench.envs.tracks.grid import Excerpt, Frame, Motion
from olne_bench.envs.tracks.reading import read_tracks
from olne_bench.envs.tracks.road import Road, RoadLane
from olne_bench.envs.tracks.road_file import RoadFile, write_road_file
from olne_bench.errors import UserError
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.games.model.costs import ControlEffort, FinalGoal, Proximity, StateDeviation
from olne_bench.games.model.game import Game, Player
from olne_bench.games.model.lanes import LaneKeeping, StraightLane
from olne_bench.games.model.observation import FullView
from tests.envs.conftest import SMALLEST

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


AWAY = np.array([5.0, 0.0, 0.0, 0.0])
Recorder = Callable[..., Recording]


def exported(folder: Path, recording: Recording, *, targets: bool = True) -> Path:
    """A table of the motion, rows shuffled and players renamed, with the road file beside it."""
    path = folder / "tracks.csv"
    episode = Episode.of(of_recordings([recording], [0], {}), 0)
    write_csv(path, episode)
    table = pd.read_csv(path).sample(frac=1, random_state=2)
    table.assign(player=table["player"].map(renamed)).to_csv(path, index=False)
    assert episode.road is not None
    if targets:
        players = {renamed(name): entry for name, entry in episode.road.players.items()}
        road = episode.road.model_copy(update={"players": players})
        write_road_file(path.with_suffix(".toml"), road)
    return path


def renamed(name: str) -> str:
    return {"player_0": "red car", "player_1": "blue", "player_2": "0"}[name]


def estimate(game: Game, y: np.ndarray) -> Estimate:
    problem = Problem(game, FullView(), noise_scale=(1.0, 1.0, 0.1, 1.0))
    rng = np.random.default_rng(0)
    return KktConstrained().estimate(problem, Observation(y), rng=rng, budget=60.0)


@pytest.mark.parametrize("name", SMALLEST)
def test_every_weight_comes_back_through_a_table(
    name: str, recorded: Recorder, tmp_path: Path
) -> None:
    recording = recorded(name, 0, num_players=SMALLEST[name])
    known = read_tracks(exported(tmp_path, recording)).recording
    explained = explain(name, None, known, 0)
    assert {one.source for one in explained.assumptions} == {"file"}
    assert explained.warnings == ()
    weights = estimate(explained.scenario.game, known.states[0]).weights
    found = dict(zip(known.metadata.episodes[0].players, weights, strict=True))
    for index, truth in enumerate(recording.scenario.weights):
        np.testing.assert_allclose(found[renamed(f"player_{index}")], truth, atol=1e-3)


@pytest.mark.parametrize("name", SMALLEST)
@pytest.mark.parametrize("frame", [Frame(shift=(1000.0, 50.0)), Frame(flip_y=True)])
@pytest.mark.parametrize("targets", [True, False])
def test_tracks_in_another_frame_are_refused(
    name: str, frame: Frame, targets: bool, recorded: Recorder, tmp_path: Path
) -> None:
    recording = recorded(name, 0, num_players=SMALLEST[name])
    path = exported(tmp_path, recording, targets=targets)
    known = read_tracks(path, frame=frame).recording
    with pytest.raises(UserError, match=r"is off the road: at \(|drives against the lanes: at \("):
        explain(name, None, known, 0)


@pytest.mark.parametrize("name", SMALLEST)
def test_without_targets_every_assumption_names_the_data(
    name: str, recorded: Recorder, tmp_path: Path
) -> None:
    recording = recorded(name, 0, num_players=SMALLEST[name])
    known = read_tracks(exported(tmp_path, recording, targets=False)).recording
    explained = explain(name, None, known, 0)
    assert {(one.what, one.source) for one in explained.assumptions} == {
        ("speed", "data"),
        ("lanes", "data"),
    }
    speeds = [one for one in explained.assumptions if one.what == "speed"]
    assert {one.how for one in speeds} == {"median speed"}


def test_a_draw_gives_its_targets_to_those_who_start_there(
    recorded: Recorder, tmp_path: Path
) -> None:
    recording = recorded("merge", 0, num_players=2)
    known = read_tracks(exported(tmp_path, recording, targets=False)).recording
    explained = explain("merge", 0, known, 0)
    order = [["red car", "blue"].index(name) for name in known.metadata.episodes[0].players]
    players = recording.scenario.game.players
    assert explained.scenario.game.players == tuple(players[k] for k in order)
    assert {one.source for one in explained.assumptions} == {"draw"}
    with pytest.raises(UserError, match="--seed 1: the players do not start where those of"):
        explain("merge", 1, known, 0)


def as_tracks(states: np.ndarray, dt: float, folder: Path) -> RecordingFile:
    """States (T, N, 4) through a table."""
    path = folder / "tracks.csv"
    times = np.repeat(dt * np.arange(len(states)), states.shape[1])
    rows = pd.DataFrame(states.reshape(-1, 4), columns=["x", "y", "heading", "speed"])
    players = np.tile([f"car {k}" for k in range(states.shape[1])], len(states))
    rows.assign(time=times, player=players).to_csv(path, index=False)
    return read_tracks(path).recording


def test_weights_mean_the_same_at_every_step(tmp_path: Path) -> None:
    scenario = get_scenario("two_player")
    dt = scenario.game.dt / 5
    known = as_tracks(cruising(scenario.initial_state, dt), dt, tmp_path)
    game = explain("two_player", None, known, 0).scenario.game
    for ours, theirs in zip(game.players, scenario.game.players, strict=True):
        for term, original in zip(
            (*ours.preferences, *ours.task), (*theirs.preferences, *theirs.task), strict=True
        ):
            factor = {ControlEffort: 25.0, FinalGoal: 5.0}.get(type(term), 1.0)
            assert term.scale == pytest.approx(factor * original.scale)  # type: ignore[attr-defined]


def test_two_hundred_steps_at_25_hz_converge_and_resampling_gives_the_step_back(
    recorded: Recorder, tmp_path: Path
) -> None:
    recording = recorded("two_way", 0, num_players=3)
    coarse = np.concatenate([recording.states, recording.extra_state[None]])
    dt = recording.scenario.game.dt
    times = 0.04 * np.arange(200)
    fine = CubicSpline(dt * np.arange(len(coarse)), coarse)(times)
    table = as_tracks(fine, 0.04, tmp_path)
    found = estimate(explain("two_way", 0, table, 0).scenario.game, table.states[0])
    assert found.converged
    # The motion had steps of 0.4 s, so weights at 0.04 s are only close.
    np.testing.assert_allclose(found.weights, recording.scenario.weights, atol=0.06)
    again = read_tracks(tmp_path / "tracks.csv", excerpt=Excerpt((0.0, 7.6), step=dt)).recording
    np.testing.assert_allclose(again.states[0], recording.states, atol=1e-9)
    game = explain("two_way", 0, again, 0).scenario.game
    np.testing.assert_allclose(
        estimate(game, again.states[0]).weights, recording.scenario.weights, atol=1e-3
    )


def cruising(start: np.ndarray, dt: float) -> np.ndarray:
    """Four states of players that drive straight on from their states (N, 4)."""
    states = np.repeat(start[None], 4, axis=0)
    way = np.stack([np.cos(start[:, 2]), np.sin(start[:, 2])], axis=1)
    states[..., :2] += dt * np.arange(4)[:, None, None] * start[:, 3:] * way
    return states


def test_plans_may_end_after_the_recording(recorded: Recorder, tmp_path: Path) -> None:
    """Without noise, weights come back from its first part if the end of the plans is told."""
    recording = recorded("two_way", 0, num_players=3)
    path, dt = exported(tmp_path, recording), recording.scenario.game.dt
    whole, seen = len(recording.states), 12
    known = read_tracks(path, excerpt=Excerpt((0.0, dt * (seen - 1)))).recording
    names = known.metadata.episodes[0].players
    truth = recording.scenario.weights[
        [[renamed(f"player_{k}") for k in range(3)].index(name) for name in names]
    ]
    off = []
    for ahead in (0.0, dt * (whole - seen)):
        game = explain("two_way", None, known, 0, ahead=ahead).scenario.game
        y = np.full((game.horizon, *known.states[0].shape[1:]), np.nan)
        y[:seen] = known.states[0]
        off.append(np.abs(estimate(game, y).weights - truth).max())
    assert game.horizon == whole
    assert off[1] < 1e-3 < 0.05 < off[0]


def test_goals_after_the_recording_are_told(tmp_path: Path) -> None:
    scenario = get_scenario("two_player")
    known = as_tracks(cruising(scenario.initial_state + AWAY, 0.25), 0.25, tmp_path)
    with pytest.raises(UserError, match="--ahead: player 'car 0' has a goal at the end of the"):
        explain("two_player", None, known, 0, ahead=1.0)
    told = cruising(scenario.initial_state, 0.25)  # players of the draw have goals
    game = explain("two_player", None, as_tracks(told, 0.25, tmp_path), 0, ahead=1.0).scenario.game
    assert game.horizon == len(told) + 4


def test_players_are_alike_unless_their_costs_differ(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    original = get_scenario("two_player")
    first, second = original.game.players
    louder = replace(second.preferences[0], scale=2.0)  # type: ignore[type-var]
    other = replace(second, preferences=(louder, *second.preferences[1:]))
    changed = replace(original, game=replace(original.game, players=(first, other)))
    monkeypatch.setattr(module, "get_scenario", lambda *_, **__: changed)
    away = cruising(original.initial_state + AWAY, 0.25)
    explained = explain("two_player", None, as_tracks(away, 0.25, tmp_path), 0)
    assert explained.warnings[0].endswith("in the order of the file: car 0 = 0, car 1 = 1")
    assert explained.scenario.game.players[1].preferences[0] == louder
    with pytest.raises(UserError, match="2 players with different costs, the recording has 1"):
        explain("two_player", None, as_tracks(away[:, :1], 0.25, tmp_path), 0)


def test_slips_in_the_road_file_are_told(tmp_path: Path) -> None:
    scenario = get_scenario("two_player")
    known = as_tracks(cruising(scenario.initial_state, 0.25), 0.25, tmp_path)
    entry = {"lanes": ["a"]}
    lanes = {"a": {"points": [[0, 0], [9, 0]]}}
    road = RoadFile.model_validate({"lanes": lanes, "players": {"car 0": entry}})
    episode = known.metadata.episodes[0].model_copy(update={"road": road})
    known = replace(known, metadata=known.metadata.model_copy(update={"episodes": [episode]}))
    words = "lanes of player 'car 0': not used, 'two_player' has no such cost"
    assert explain("two_player", None, known, 0).warnings == (words,)


def test_tracks_too_short_to_tell_their_noise_are_taken_for_exact(tmp_path: Path) -> None:
    """Three samples have no third difference; the tolerance for noise is then zero."""
    scenario = get_scenario("two_player")
    start = scenario.initial_state.copy()
    for count, off, matched in ((3, 0.0, True), (3, 0.4, False), (4, 0.0, True)):
        states = cruising(start, 0.25)[:count].copy()
        states[..., 0] += off
        explained = explain("two_player", None, as_tracks(states, 0.25, tmp_path), 0)
        assert np.isnan(explained.noise) == (count == 3)
        assert ({one.source for one in explained.assumptions} == {"draw"}) == matched
