"""Recording, importing tracks and estimating from both, end to end."""

import gc
import re
import subprocess
import time
from contextlib import suppress
from importlib import import_module
from types import SimpleNamespace

import imageio_ffmpeg
import numpy as np
import pandas as pd
import pytest
from PIL import Image, ImageSequence

from olne_bench.bench.commands.cli import main
from olne_bench.bench.judge.fit import Fit
from olne_bench.bench.judge.players import Answer, PlayerFault
from olne_bench.bench.judge.raw_estimate import read_estimate
from olne_bench.bench.run.player_process import PlayerProcess
from olne_bench.envs.recordings import recording
from olne_bench.envs.recordings.recording_file import read_recording
from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.solved.equilibrium import NoEquilibriumError
from olne_bench.envs.tracks.explained import DATA, Assumption
from olne_bench.errors import UserError
from olne_bench.estimators.protocol import Estimate, Problem
from olne_bench.games.model.observation import FullView


def run(*arguments):
    main([str(argument) for argument in arguments])


def fails(capsys, *arguments):
    capsys.readouterr()
    with pytest.raises(SystemExit) as caught:
        run(*arguments)
    assert caught.value.code == 2
    error = capsys.readouterr().err.strip().splitlines()
    assert error[-1].startswith("olne-bench: error: ")
    return error[-1]


# -- record ----------------------------------------------------------------------------------


def test_record_writes_every_draw(tmp_path, capsys):
    out = tmp_path / "random.parquet"
    options = ("--option", "num_players=3", "--option", "num_players=2")  # the last one counts
    run("record", "random", "--seeds", 3, *options, "--out", out)
    captured = capsys.readouterr()
    assert "3 of 3 episodes of random" in captured.out
    assert "3/3" in captured.err  # the progress bar
    # Two players: two near plans each; 17 far ones, and four past the other.
    assert re.search(
        r"certified: local, largest gain \S+ from 12 first plans; global so far, largest gain \S+ "
        "from 126 first plans",
        captured.out,
    )
    known = read_recording(out)
    assert known.metadata.options == {"num_players": 2}
    assert [entry.seed for entry in known.metadata.episodes] == [0, 1, 2]
    for seed, states in enumerate(known.states):
        scenario = get_scenario("random", seed, num_players=2)
        np.testing.assert_array_equal(states[0], scenario.initial_state)


def test_a_fixed_scenario_is_recorded_once(tmp_path, capsys):
    run("record", "two_player", "--seeds", 5, "--out", tmp_path / "two.parquet")
    captured = capsys.readouterr()
    assert "1 of 1 episodes" in captured.out and "same for every seed" in captured.err


def test_draws_without_equilibrium_are_named_and_not_written(tmp_path, capsys, monkeypatch):
    certified = recording.certified_equilibrium

    def refuse_the_second(scenario):
        if np.array_equal(scenario.initial_state, get_scenario("random", 1).initial_state):
            raise NoEquilibriumError("no certified equilibrium of 'random'")
        return certified(scenario)

    monkeypatch.setattr(recording, "certified_equilibrium", refuse_the_second)
    out = tmp_path / "random.parquet"
    run("record", "random", "--seeds", 3, "--out", out)
    printed = capsys.readouterr().out
    assert "seed 1 is not recorded: no certified equilibrium" in printed
    assert "2 of 3 episodes" in printed
    assert [entry.seed for entry in read_recording(out).metadata.episodes] == [0, 2]


def test_no_draw_with_an_equilibrium_leaves_nothing(tmp_path, capsys, monkeypatch):
    def refuse(_):
        raise NoEquilibriumError("no certified equilibrium")

    monkeypatch.setattr(recording, "certified_equilibrium", refuse)
    error = fails(capsys, "record", "two_player", "--out", tmp_path / "two.parquet")
    assert "nothing is written" in error
    assert not list(tmp_path.iterdir())


def decode(video):
    """All frames' values in one array."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", video]
    command += ["-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    return np.frombuffer(subprocess.run(command, check=True, capture_output=True).stdout, np.uint8)


def test_videos_show_moving_cars(tmp_path):
    gif, mp4 = tmp_path / "two.gif", tmp_path / "two.mp4"
    for number, video in enumerate((gif, mp4)):
        run("record", "two_player", "--out", tmp_path / f"{number}.parquet", "--video", video)
    with Image.open(gif) as images:
        frames = [np.array(image.convert("RGB")) for image in ImageSequence.Iterator(images)]
        assert images.info["duration"] == 1000 * get_scenario("two_player").game.dt  # real time
    height, width = (size // 2 * 2 for size in frames[0].shape[:2])
    decoded = decode(mp4).reshape(-1, height, width, 3)
    assert len(frames) == len(decoded) == 25
    for film in (frames, decoded):
        assert all(frame.std() > 5 for frame in film)
        assert np.abs(film[0].astype(int) - film[-1]).max() > 50
    gc.collect()  # pipes that the writer left open would be reported now
    shown = np.array(frames[12])[:height, :width].astype(int)
    assert np.abs(shown - decoded[12]).mean() < 5  # the same picture, up to compression


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["nope", "--out", "a.parquet"], "unknown scenario 'nope'; known are: changed, foll"),
        (["random", "--out", "a.csv"], "--out a.csv: the name must end in .parquet"),
        (["random", "--out", "no/a.parquet"], "there is no folder 'no'"),
        (["random", "--out", "a.parquet", "--video", "a.avi"], "must end in .mp4 or .gif"),
        (["random", "--out", "a.parquet", "--seeds", "0"], "0 is not in the range"),
        (["random", "--out", "a.parquet", "--option", "n=1"], "no option 'n'; known are: num_p"),
        (["random", "--out", "a.parquet", "--option", "n"], "expected NAME=VALUE"),
        (["random", "--out", "a.parquet", "--option", "num_players=0"], "must be 1 to 50, got 0"),
        (["random", "--out", "a.parquet", "--option", "num_players=x"], "--option: "),
    ],
)
def test_bad_recordings_are_refused(tmp_path, capsys, monkeypatch, arguments, expected):
    monkeypatch.chdir(tmp_path)
    assert expected in fails(capsys, "record", *arguments)
    assert not list(tmp_path.iterdir())


def test_nothing_is_overwritten(tmp_path, capsys):
    out = tmp_path / "two.parquet"
    out.write_text("precious")
    assert "exists already" in fails(capsys, "record", "two_player", "--out", out)
    new = tmp_path / "new.parquet"
    video = tmp_path / "two.gif"
    video.write_text("precious")
    arguments = ("record", "two_player", "--out", new, "--video", video)
    assert "exists already" in fails(capsys, *arguments)
    assert out.read_text() == video.read_text() == "precious"
    assert not new.exists()


# -- import ----------------------------------------------------------------------------------

TIMES = (0.0, 0.1, 0.2, 0.3)


def tracks(**columns):
    """Two cars, 10 m/s along x, in two lanes."""
    rows = [(t, p, 10 * t, 3.5 * k) for t in TIMES for k, p in enumerate(("car", "van"))]
    table = pd.DataFrame(rows, columns=["time", "player", "x", "y"])
    return table.assign(**columns)


def imported(tmp_path, table):
    source, out = tmp_path / "tracks.csv", tmp_path / "tracks.parquet"
    source.write_text(table if isinstance(table, str) else table.to_csv(index=False))
    run("import", source, "--out", out)
    return read_recording(out)


def test_import_keeps_what_is_known(tmp_path, capsys):
    table = tracks(speed=10.0, colour="red")
    table.loc[3, ["x", "y", "speed"]] = np.nan  # the van is hidden at 0.1 s
    known = imported(tmp_path, table)
    captured = capsys.readouterr()
    assert "2 players, 4 steps of 0.1 s" in captured.out
    assert "not used: column colour" in captured.err
    assert known.metadata.kind == "tracks"
    assert known.metadata.episodes[0].players == ["car", "van"]
    assert known.metadata.episodes[0].weights is None
    assert known.metadata.dt == pytest.approx(0.1)
    (states,) = known.states
    assert states.shape == (4, 2, 4)
    np.testing.assert_allclose(states[:, 0, 0], [0, 1, 2, 3])
    assert np.isnan(states[1, 1]).all() and np.isnan(states[..., 2]).all()
    assert (states[2, :, 3] == 10).all()


def test_a_car_in_reverse_may_head_the_other_way(tmp_path):
    known = imported(tmp_path, tracks(heading=3.0, speed=-10.0))
    assert (known.states[0][..., 3] == -10).all()


#: Some; the tests of ``envs/tracks`` have all.
BAD_TRACKS = {
    "no column": (tracks().drop(columns="y"), "missing column y; it has: time, player, x"),
    "ragged": ("time,player,x,y\n0,a,0,0,0,0\n", "not a CSV file"),
    "text": (tracks().replace({"x": {2.0: "1,5"}}), "is '1,5', expected a finite number"),
    "km/h": (tracks(speed=36.0), "mean speed of 36, but its positions move at 10 m/s"),
}


@pytest.mark.parametrize("case", BAD_TRACKS)
def test_bad_tracks_are_refused(case, tmp_path, capsys):
    table, expected = BAD_TRACKS[case]
    source, out = tmp_path / "tracks.csv", tmp_path / "tracks.parquet"
    source.write_text(table if isinstance(table, str) else table.to_csv(index=False))
    assert expected in fails(capsys, "import", source, "--out", out)
    assert not out.exists()


def test_tracks_that_are_not_there_or_not_text(tmp_path, capsys):
    out = tmp_path / "tracks.parquet"
    assert "no tracks file" in fails(capsys, "import", tmp_path / "no.csv", "--out", out)
    binary = tmp_path / "binary.csv"
    binary.write_bytes(b"time,player\n\x00\xfe,1\n")
    assert "not a CSV file" in fails(capsys, "import", binary, "--out", out)
    out.write_text("precious")
    assert "exists already" in fails(capsys, "import", binary, "--out", out)
    assert out.read_text() == "precious"


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--format", "nope"], "unknown format 'nope'; known are: commonroad, csv, highd, ind"),
        (["--window", "3,1"], "'3,1' does not begin before it ends"),
        (["--window", "3"], "'3' is not a pair of numbers A,B"),
        (["--shift", "1,inf"], "'1,inf' is not a pair of numbers A,B"),
        (["--resample", "0"], "0.0 is not in the range"),
        (["--rotate", "nan"], "nan is not a finite number"),
        (["--players", "bus"], "--players 'bus': "),
        (["--road", "none.toml"], "no road file 'none.toml'"),
        (["--part", "1"], "--part '1': files of this format have no parts"),
    ],
)
def test_options_of_import_are_checked(tmp_path, capsys, monkeypatch, arguments, expected):
    monkeypatch.chdir(tmp_path)
    tracks().to_csv("tracks.csv", index=False)
    error = fails(capsys, "import", "tracks.csv", "--out", "a.parquet", *arguments)
    assert expected in error
    assert not (tmp_path / "a.parquet").exists()


# -- export ----------------------------------------------------------------------------------


def test_exports_refuse_what_exists_and_other_suffixes(tmp_path, capsys):
    truth = tmp_path / "a.parquet"
    run("record", "two_player", "--out", truth)
    assert "must end in .csv or .xml" in fails(capsys, "export", truth, "--out", tmp_path / "a.txt")
    (tmp_path / "b.toml").write_text("precious")
    assert "b.toml exists already" in fails(capsys, "export", truth, "--out", tmp_path / "b.csv")
    assert not (tmp_path / "b.csv").exists()
    arguments = ("export", truth, "--episode", 1, "--out", tmp_path / "c.csv")
    assert "has the episodes 0 to 0" in fails(capsys, *arguments)


# -- estimate --------------------------------------------------------------------------------


def tracks_of(recording, tmp_path, **shift):
    """An equilibrium as a user's tracks: positions only, one sample hidden."""
    rows = [
        (recording.scenario.game.dt * step, f"robot_{player}", *state[:2])
        for step, states in enumerate(recording.states)
        for player, state in enumerate(states)
    ]
    table = pd.DataFrame(rows, columns=["time", "player", "x", "y"])
    table.loc[10, ["x", "y"]] = np.nan
    for column, by in shift.items():
        table[column] += by
    imported(tmp_path, table)
    return tmp_path / "tracks.parquet"


@pytest.fixture
def own_tracks(tmp_path, recorded):
    return tracks_of(recorded("two_player"), tmp_path)


def test_players_who_start_as_those_of_a_fixed_scenario_have_their_targets(
    tmp_path, capsys, recorded
):
    path, out = tracks_of(recorded("highway_overtaking"), tmp_path), tmp_path / "weights.csv"
    capsys.readouterr()
    run("estimate", path, "--scenario", "highway_overtaking", "--out", out)
    said = capsys.readouterr()
    assert "draw" in said.out and "warning" not in said.err
    table = pd.read_csv(out)
    assert list(table["player"]) == [f"robot_{player}" for player in range(5)]
    truth = get_scenario("highway_overtaking")
    estimated = table[list(truth.game.weight_names)]
    np.testing.assert_allclose(estimated, truth.weights, atol=1e-3)
    assert table["converged"].all() and (table["residual"] < 1e-3).all()
    assert set(table["fit"]) <= {"fits", "not testable"} and (table["noise"] > 0).all()


def test_estimators_run_on_recordings_with_truth(tmp_path, capsys):
    path, out = tmp_path / "road.parquet", tmp_path / "weights.csv"
    run("record", "highway_overtaking", "--out", path)
    run("estimate", path, "--estimator", "kkt_residual", "--out", out)
    truth = get_scenario("highway_overtaking")
    estimated = pd.read_csv(out)[list(truth.game.weight_names)]
    np.testing.assert_allclose(estimated, truth.weights, atol=1e-2)
    assert "no standard errors" in capsys.readouterr().err


def test_motion_that_the_model_does_not_explain_is_warned_of(tmp_path, capsys, recorded):
    path = tracks_of(recorded("highway_overtaking"), tmp_path, x=3.0)
    given = ("--scenario", "highway_overtaking", "--noise", 1e-3, "--targets", "fixed")
    run("estimate", path, *given)
    said = capsys.readouterr()
    assert "noise 0.001 m (--noise)" in said.out
    assert "the model does not explain the motion, do not rely on these weights" in said.err
    assert "targets guessed from the data (source 'data'): px, speed" in said.err


def test_plans_may_end_after_the_recording(tmp_path, recorded, capsys):
    """The first half of a recording has all weights, if the end of the plans is told."""
    true, out = recorded("two_player"), tmp_path / "weights.csv"
    half, dt = len(true.states) // 2, true.scenario.game.dt
    tracks_of(true, tmp_path)
    window = f"0,{(half - 1) * dt}"
    given = ("--window", window, "--out", tmp_path / "half.parquet")
    run("import", tmp_path / "tracks.csv", *given)
    ahead = (len(true.states) - half) * dt
    given = ("--scenario", "two_player", "--noise", 1e-3, "--ahead", ahead)
    capsys.readouterr()
    run("estimate", tmp_path / "half.parquet", *given, "--out", out)
    assert f"plans end {ahead:g} s after the recording" in capsys.readouterr().out
    table, names = pd.read_csv(out), list(true.scenario.game.weight_names)
    np.testing.assert_allclose(table[names], true.scenario.weights, atol=1e-2)


def test_guessed_targets_are_estimated_with_the_weights(tmp_path, capsys, recorded):
    """Without noise they are found, as is where somebody drives in the lane."""
    true = recorded("following")
    path = tracks_of(true, tmp_path)
    beside = tmp_path / "lane.toml"
    beside.write_text("[lanes.lane]\npoints = [[-200, 0.2], [900, 0.2]]\n")
    run("import", tmp_path / "tracks.csv", "--road", beside, "--out", tmp_path / "lane.parquet")
    out = tmp_path / "weights.csv"
    given = ("--scenario", "following", "--noise", 1e-3, "--estimator", "map")
    run("estimate", tmp_path / "lane.parquet", *given, "--out", out)
    said = capsys.readouterr().out
    assert "median speed, then estimated" in said and "targets that were estimated:" in said
    table = pd.read_csv(out)
    speeds = [player.preferences[1].target for player in true.scenario.game.players]
    assert table["offset"].to_numpy() == pytest.approx(-0.2, abs=0.01)
    off = np.abs(table["target speed"] - speeds) / table["target speed_error"]
    assert off.max() < 2.5 and table["residual"].max() < 1e-3
    assert path.exists()


RAISES = """class Raises:
    name = "raises"
    def estimate(self, *args, **kwargs):
        raise RuntimeError("no licence")
"""


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--scenario", "nope"], "--scenario: unknown scenario 'nope'; known are"),
        (["--scenario", "highway", "--seed", "0"], "holds 3 to 8 players, got num_players = 2"),
        (["--scenario", "merge"], "player 'robot_1' drives against the lanes: at (-0.0"),
        (["--scenario", "random", "--seed", "7"], "--seed 7: the players do not start where"),
        (["--scenario", "two_player", "--estimator", "x"], "unknown estimator 'x'; known are"),
        (["--scenario", "two_player", "--episode", "1"], "has the episodes 0 to 0"),
        (["--scenario", "two_player", "--episode", "-1"], "-1 is not in the range x>=0"),
        (["--scenario", "two_player", "--seed", "-1"], "-1 is not in the range x>=0"),
        (["--scenario", "two_player", "--noise", "0"], "0 is not in the range x>0"),
        (["--scenario", "two_player", "--ahead", "-1"], "-1.0 is not in the range x>=0"),
        (["--scenario", "two_player", "--budget", "nan"], "nan is not a finite number"),
        (["--scenario", "two_player", "--budget", "inf"], "inf is not a finite number"),
        (["--scenario", "two_player", "--estimator", "RAISES"], "RuntimeError: no licence ("),
        ([], "names no scenario; give one with --scenario"),
    ],
)
def test_bad_estimates_are_refused(own_tracks, tmp_path, capsys, arguments, expected):
    out, plugin = tmp_path / "weights.csv", tmp_path / "raises.py"
    plugin.write_text(RAISES)
    arguments = [str(plugin) if word == "RAISES" else word for word in arguments]
    assert expected in fails(capsys, "estimate", own_tracks, *arguments, "--out", out)
    assert not out.exists()


# -- what is said of an estimate -------------------------------------------------------------

estimating = import_module("olne_bench.bench.commands.estimate")
STEPS = 5


def fit_of(*, off=0.0, covariance=4e-4, states=True, converged=True, message="", sigma=0.1):
    """An estimate that lies so far [m] beside the second player's motion."""
    game = get_scenario("two_player").game
    y = np.zeros((game.horizon, 2, 4))
    expected = y.copy()
    y[:, 1, :2] = off
    result = Estimate(
        weights=np.array([[0.1, 0.2, 0.3, 0.4], [0.25] * 4]),
        states=expected if states else None,
        covariance=None if covariance is None else covariance * np.eye(8),
        converged=converged,
        message=message,
    )
    return Fit(Problem(game, FullView(), sigma=sigma), y, result)


def told_of(capsys, fit, source="the tracks"):
    players = ["one", "two"]
    names = fit.problem.weight_names
    estimating._say_result(estimating._table(players, names, fit), players, fit, source)
    said = capsys.readouterr()
    return [" ".join(line.split()) for line in said.out.splitlines()], said.err


WITH_ERRORS = "one 0.1000 ± 0.02 0.2000 ± 0.02 0.3000 ± 0.02 0.4000 ± 0.02"


@pytest.mark.parametrize(
    ("given", "heading", "weights", "last", "warned"),
    [
        ({}, "weights ± standard error:", WITH_ERRORS, "residual 0 m", ""),
        ({"covariance": None}, "weights:", "one 0.1000 0.2000 0.3000 0.4000", "residual 0 m", "no"),
        ({"states": False}, "weights ± ", WITH_ERRORS, "the estimator gives no motion to comp", ""),
    ],
)
def test_weights_are_told_with_what_is_known(capsys, given, heading, weights, last, warned):
    out, err = told_of(capsys, fit_of(**given))
    assert out[0].startswith(heading) and out[2] == weights
    assert out[-2].startswith(last) and out[-2].endswith("noise 0.1 m (the tracks)")
    assert out[-1].startswith(("not testable: ", "the model does not fit"))
    err = err.replace("warning: the model does not fit, do not rely on these weights\n", "")
    assert err.startswith(f"{warned} standard errors") if warned else err == ""


def test_who_is_not_explained_is_named_and_the_option_where_it_was_not_used(capsys):
    fit = fit_of(off=1.0)
    _, err = told_of(capsys, fit)
    assert err.count("warning") == 1
    assert "far above the noise for two (0.71 m)" in err
    assert "smoothed tracks look less noisy than they are; set --noise" in err
    _, err = told_of(capsys, fit, estimating.TOLD)
    assert "smoothed" not in err


@pytest.mark.parametrize("message", ["", "time limit reached"])
def test_an_estimate_that_did_not_converge_is_told_with_its_reason(capsys, message):
    _, err = told_of(capsys, fit_of(converged=False, message=message))
    reason = message or "the estimator gives no reason"
    assert err.splitlines()[-1] == f"not converged, do not rely on these weights: {reason}"


def test_a_table_has_a_row_of_weights_and_errors_for_each_player():
    names = fit_of().problem.weight_names
    table = estimating._table(["one", "two"], names, fit_of())
    doubts = ["converged", "residual", "noise", "fit", "fit_p"]
    assert list(table) == ["player", *names, *(f"{name}_error" for name in names), *doubts]
    assert table["player"].tolist() == ["one", "two"]
    np.testing.assert_allclose(table[list(names)], [[0.1, 0.2, 0.3, 0.4], [0.25] * 4])
    np.testing.assert_allclose(table[[f"{name}_error" for name in names]], 0.02)


@pytest.mark.parametrize(("dt", "step"), [(0.04, "0.1"), (0.05, "0.1"), (0.2, "0.4")])
def test_a_game_has_so_many_steps(dt, step):
    estimating._check_length("a", estimating.MOST_STEPS, dt)
    with pytest.raises(UserError, match=f"a has 401 steps of {dt:g} s.*--resample {step} "):
        estimating._check_length("a", estimating.MOST_STEPS + 1, dt)
    estimating._check_length("a", estimating.MOST_STEPS - 50, dt, 50 * dt)
    with pytest.raises(UserError, match=f"--ahead .*: a has 350 steps.*at most {50 * dt:g} s"):
        estimating._check_length("a", estimating.MOST_STEPS - 50, dt, 51 * dt)


def test_what_is_known_of_the_motion_is_what_is_observed():
    game = get_scenario("two_player").game
    names = list(game.dynamics.state_names)
    states = np.random.default_rng(0).normal(size=(STEPS, 2, 4))
    states[0, 0] = np.nan
    view, y = estimating._observation(game, names, states)
    assert view == FullView() and y is states
    states[..., 2] = np.nan
    view, y = estimating._observation(game, names, states)
    assert view.components == ("px", "py", "speed")
    np.testing.assert_array_equal(y, states[..., [0, 1, 3]])
    with pytest.raises(UserError, match="states have no vx; they have: px, py, heading, speed"):
        estimating._observation(game, ["px", "py", "heading", "vx"], states)


def test_targets_are_listed_and_warned_of_where_the_data_suggested_them(capsys):
    told = [
        Assumption(player="one", what="speed", value="9 m/s", source="road", how="said"),
        Assumption(player="two", what="goal", value="(1, 2)", source=DATA, how="last seen"),
    ]
    estimating._say_assumptions("merge", 0.25, told)
    said = capsys.readouterr()
    first, _, *rows = (" ".join(line.split()) for line in said.out.splitlines())
    assert first == "costs of 'merge' at steps of 0.25 s, with these targets:"
    assert rows == ["one speed 9 m/s road said", f"two goal (1, 2) {DATA} last seen"]
    assert "targets guessed from the data (source 'data'): goal; the weights depend" in said.err
    begun = Assumption(player="two", what="speed", value="9 ± 3", source=DATA, is_free=True)
    estimating._say_assumptions("merge", 0.25, [told[0], begun])
    assert capsys.readouterr().err == ""


def test_intervals_are_told_in_time_and_an_open_end_is_marked(capsys, monkeypatch):
    ends, asked = np.broadcast_to([0.05, 0.45], (2, 4, 2)).copy(), []
    ends[0, 1, 1] = np.nan
    monkeypatch.setattr(Fit, "intervals", lambda _, deadline: asked.append(deadline) or ends)
    found, before = fit_of(), time.monotonic()
    table = estimating._table(["one", "two"], found.problem.weight_names, found)
    estimating._find_intervals(table, found, 0.0)
    err = capsys.readouterr().err
    assert "not found within 0 s" in err and "a longer --budget finds more" in err
    asked.clear()
    estimating._find_intervals(table, found, 7.0)
    assert before + 7 <= asked[0] <= time.monotonic() + 7
    out, err = capsys.readouterr()
    rows = [" ".join(line.split()) for line in out.splitlines()]
    assert rows[rows.index("95 % intervals:") + 2].startswith("one 0.050 to 0.450 0.050 to ?")
    assert "cannot be followed" in err and "--budget" not in err  # there was time
    name = found.problem.weight_names[0]
    assert table[f"{name}_low"].tolist() == [0.05, 0.05]
    assert table[f"{name}_high"].tolist() == [0.45, 0.45]


@pytest.mark.parametrize("interrupted", [False, True])
def test_weights_come_before_intervals_and_survive_an_interrupt(
    tmp_path, recorded, capsys, monkeypatch, interrupted
):
    path, out = tracks_of(recorded("two_player"), tmp_path, x=3.0), tmp_path / "weights.csv"
    answer = Answer(estimate=read_estimate(SimpleNamespace(weights=np.ones((2, 4)))), seconds=50.0)
    tasks = []
    monkeypatch.setattr(PlayerProcess, "estimate", lambda _, task: tasks.append(task) or answer)

    def intervals(_, deadline):
        assert "weights:" in capsys.readouterr().out
        assert deadline - time.monotonic() < 12.1  # a fifth of the budget, as 50 s are gone
        if interrupted:
            raise KeyboardInterrupt

    monkeypatch.setattr(Fit, "intervals", intervals)
    with suppress(SystemExit):
        run("estimate", path, "--scenario", "two_player", "--out", out)
    assert len(pd.read_csv(out)) == 2
    rehearsal, task = tasks
    assert task.budget == 60 and task.time_limit == 75 and rehearsal.budget < 0.01
    assert task.set_up_limit == rehearsal.time_limit > 500  # compilation is apart


def test_who_is_late_is_told_what_helps(tmp_path, capsys, monkeypatch, recorded):
    def late(*_):
        raise PlayerFault("timeout", "killed after 9 s of estimate")

    monkeypatch.setattr(PlayerProcess, "estimate", late)
    path = tracks_of(recorded("two_player"), tmp_path, x=3.0)
    error = fails(capsys, "estimate", path, "--scenario", "two_player")
    assert "killed after 9 s of estimate; give a longer --budget, or import fewer" in error
