"""End-to-end runs of the command line."""

import os
import pathlib
import re
import signal
import subprocess
import sys
from collections import Counter
from importlib import import_module
from inspect import signature
from types import SimpleNamespace

import pandas as pd
import pytest

from olne_bench.bench.commands.cli import main
from olne_bench.bench.commands.interface import COMMANDS, recordings, studies
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.suite import Suite


def fails(capsys, *arguments):
    with pytest.raises(SystemExit) as caught:
        main([str(argument) for argument in arguments])
    assert caught.value.code == 2
    error = capsys.readouterr().err.strip()
    assert error.startswith("olne-bench: error: ")
    assert "\n" not in error
    return error


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["run", "nope"], "unknown suite 'nope'; known are: calibration, constrained, driving, d"),
        (["run", "quick", "--scenario", "x"], "no scenario 'x'; it has: merge, two_player"),
        (["run", "quick", "--sensor", "x"], "no sensor 'x'; it has: full, partial"),
        (["run", "quick", "--estimator", "x"], "no estimator 'x'; it has: kkt_constrained"),
        (["run", "quick", "--sigma", "-1"], "no sigma -1.0; it has: 0.0"),
        (["run", "quick", "--sigma", "x"], "'x' is not a valid float"),
        (["run", "quick", "--seeds", "0"], "0 is not in the range"),
        (["run", "quick", "--estimator", "unifrom"], "nearest: uniform"),
        (["run", "quick", "--kind", "motions"], "'motions' is not one of 'trials', 'streams'"),
        (["run", "quick", "--rule", "lag=8"], "a study of trials has no rule 'lag'"),
        (["run", "online", "--rule", "lag=1"], "rules.lag: Input should be greater than or equal"),
        (["run", "online", "--rule", "deadline=0"], "rules.deadline: Input should be greater"),
        (["run", "online", "--rule", "fit_every"], "expected NAME=VALUE, such as lag=8"),
        (["run", "online", "--rule", "delay=2"], "unknown key 'rules.delay'; known are: deadline"),
        (["run", "online", "--rule", "lag=21"], "has 20 samples; use fewer"),
        (["run", "driving", "--rule", "lag=8"], "a study of drives has no rule 'lag'; its rules"),
        (["run", "driving", "--rule", "window=101"], "window = 101: a drive has 100 samples"),
        (["run", "driving", "--scenario", "merging"], "drives are on one of highway, merge"),
        (["run", "driving", "--estimator", "mapp"], "no estimator 'mapp'; it has: oracle, uniform"),
        (["run", "driving", "--sensor", "partial"], "in a study of drives it is 'full'"),
        (["run", "driving_stock", "--kind", "streams"], "traffic"),
        (["run", "roads", "--scenario", "merging", "--sigma", "1"], "no scenario with such noise"),
        (["run", "quick", "--jobs", "0"], "0 is not in the range"),
        (["run", "quick", "--memory", "nan"], "nan is not a finite number"),
        (["run", "quick", "--memory", "inf"], "inf is not in the range"),
        (["run", "quick", "--memory", "0.01"], "0.01 is not in the range 0.5<=x"),
        (["check", "uniform", "--memory", "nan"], "nan is not a finite number"),
        (["check", "uniform", "--budget", "inf"], "inf is not a finite number"),
        (["run", "quick", "--frobnicate"], "known are: --out, --jobs"),
        (["run", "quick", "--plugin", "no.py"], "no plugin file"),
        (["frobnicate"], "known are: check, compare, confirm, draws, estimate, export, film, ga"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(tmp_path, capsys, arguments, expected):
    out = tmp_path / "out"
    extra = ["--out", out] if arguments[0] == "run" else []
    assert expected in fails(capsys, *arguments, *extra)
    assert not out.exists()


def test_a_run_is_not_merged_with_itself(tmp_path, capsys):
    again = tmp_path / "x" / ".."
    (tmp_path / "x").mkdir()
    assert "with itself" in fails(capsys, "merge", tmp_path, again)
    for one, other in (("a", "b"), ("b", "a")):
        assert "no run in" in fails(capsys, "merge", tmp_path / one, tmp_path / other)


def test_list_names_everything(capsys):
    main(["list"])
    listed = capsys.readouterr().out
    for name in ("paper", "quick", "two_player", "highway_overtaking", "random", "num_players"):
        assert name in listed
    for name in ("full", "partial", "kkt_constrained", "kkt_residual", "uniform"):
        assert name in listed


def run_all(monkeypatch, statuses, stop_after=None):
    """The stored statuses of trials with these outcomes, and the reported signal."""
    module = import_module("olne_bench.bench.commands.run")
    study = import_module("olne_bench.bench.run.study")

    def ended(todo, *, stop, **_limits):
        for number, status in enumerate(todo):
            if stop():
                return
            yield None, Outcome(status, "a fault")
            if number + 1 == stop_after:
                os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(study, "run_trials", ended)
    kept = []
    store = SimpleNamespace(add=lambda _, outcome: kept.append(outcome.status))
    machine = study.Machine(pathlib.Path("runs/a"))
    return kept, module.run_all(statuses, len(statuses), store, machine)


def test_a_run_that_is_stopped_tells_what_is_left(monkeypatch, capsys):
    kept, told = run_all(monkeypatch, ["ok"] * 5, stop_after=2)
    assert (kept, told) == (["ok"] * 2, signal.SIGINT)
    said = capsys.readouterr().err
    assert "interrupted: 2 trials of this run are stored in runs/a, 3 remain" in said


@pytest.mark.parametrize("stop_after", [None, 3])
def test_a_run_that_got_all_done_was_not_stopped(monkeypatch, capsys, stop_after):
    kept, told = run_all(monkeypatch, ["ok", "crash", "ok"], stop_after)
    assert (kept, told) == (["ok", "crash", "ok"], None)
    said = capsys.readouterr().err
    assert "interrupted" not in said
    assert "could not be judged" not in said
    assert "crash=1" in said


def test_faults_of_the_harness_are_told_at_the_end(monkeypatch, capsys):
    run_all(monkeypatch, ["ok", "harness_error", "harness_error"])
    said = capsys.readouterr().err
    assert "2 trials could not be judged (harness_error). They do not count" in said
    assert "2 times: a fault" in said
    assert "other messages" not in said


@pytest.mark.parametrize("cluster", [None, "local"])
def test_trials_are_run_here_or_on_a_cluster(monkeypatch, tmp_path, cluster):
    module = import_module("olne_bench.bench.run.study")
    calls = {}
    for name in ("run_trials", "run_on_dask"):
        monkeypatch.setattr(
            module, name, lambda _, _name=name, **words: calls.update({_name: words}) or ()
        )
    machine = module.Machine(tmp_path / "x" / "..", jobs=3, dask=cluster, memory=1.5)
    assert list(module.run_stored([], machine, None, None)) == []
    ((name, words),) = calls.items()
    assert name == ("run_on_dask" if cluster else "run_trials")
    assert words.get("cluster", words.get("jobs")) == (cluster or 3)
    assert (words["memory"], words["hidden"]) == (3 * 2**29, tmp_path.resolve())
    assert words["log"].parent == tmp_path.resolve()


@pytest.mark.parametrize("kinds", [1, 2, 40])
def test_many_faults_are_told_by_the_most_frequent(capsys, kinds):
    module = import_module("olne_bench.bench.commands.run")
    faults = Counter({f"fault {k} " + "x" * 400: k + 1 for k in range(kinds)})
    module.show_faults(faults)
    first, *told = capsys.readouterr().err.splitlines()
    assert first.startswith(f"{faults.total()} trials could not be judged")
    shown = [line for line in told if "times: " in line]
    assert shown[0].startswith(f"  {kinds} times: fault {kinds - 1} x")
    assert max(map(len, shown)) < 330
    rest = kinds - len(shown)
    assert told[len(shown) :] == ([f"  and {rest} other messages"] if rest else [])
    assert 1 <= len(shown) <= 10
    module.show_faults(Counter())
    assert capsys.readouterr().err == ""


LIMITED = """
name = "limited"
scenarios = ["two_player", {name = "random", options = {num_players = 3}, seeds = 1}]
sensors = ["full"]
sigmas = [0.05]
seeds = 2
estimators = ["uniform", {name = "kkt_residual", scenarios = ["two_player"]}]

[gate.kkt_residual]
cosine_error = 1.0
"""


@pytest.mark.long
def test_an_estimator_that_runs_on_some_scenarios_only(tmp_path, capsys):
    suite, run = tmp_path / "limited.toml", tmp_path / "run"
    suite.write_text(LIMITED)
    main(["run", str(suite), "--out", str(run)])
    board = pd.read_csv(run / "leaderboard.csv")
    rows = {(row.scenario, row.estimator): row.trials for row in board.itertuples()}
    elsewhere = "random(num_players=3)"
    assert rows == {
        ("two_player", "uniform"): 2,
        ("two_player", "kkt_residual"): 2,
        (elsewhere, "uniform"): 1,
    }
    assert (run / "index.html").exists()
    assert any((run / "figures").iterdir())
    capsys.readouterr()
    main(["status", str(run)])
    status = capsys.readouterr().out
    assert status.count("kkt_residual") == 1
    assert "'olne-bench run'" not in status, "nothing is missing"
    for command in (["gate", str(run)], ["compare", str(run), str(run)]):
        with pytest.raises(SystemExit) as caught:
            main(command)
        assert caught.value.code == 0
    printed = capsys.readouterr().out
    assert "1 of 1 limits hold" in printed
    assert "0 worse" in printed


def test_help_and_list_import_nothing_slow():
    slow = {"numpy", "pandas", "casadi", "scipy", "matplotlib", "highway_env", "pydantic", "tqdm"}
    helps = [["--help"], ["--version"], ["list"], *([name, "--help"] for name in COMMANDS)]
    code = (
        "import sys; from olne_bench.bench.commands.cli import main\n"
        f"for arguments in {helps}:\n"
        "    try: main(arguments)\n"
        "    except SystemExit: pass\n"
        f"    print('slow:', arguments, sorted({slow} & set(sys.modules)))"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    found = [line for line in said.stdout.splitlines() if line.startswith("slow:")]
    assert found == [f"slow: {arguments} []" for arguments in helps]


def test_what_help_repeats_is_true():
    """Some numbers and names stand in the interface again, as imports of their homes are slow."""
    from olne_bench.bench.submission.fresh_draws import FEWEST
    from olne_bench.envs.track_formats import format_names

    assert studies.FEWEST == FEWEST
    assert list(recordings.FORMATS) == format_names()


@pytest.mark.parametrize("name", sorted({*COMMANDS} - {"run"}))
def test_a_command_is_called_with_all_that_it_takes(name):
    work = {"list": "list_all", "import": "import_tracks"}.get(name, name)
    found = getattr(import_module(f"olne_bench.bench.commands.{work}"), work)
    assert {one.name for one in COMMANDS[name].params} == set(signature(found).parameters)


def test_help_has_a_sentence_on_every_command(capsys):
    main(["--help"])
    said = capsys.readouterr().out
    for name in COMMANDS:
        assert re.search(rf"^  {name} +[A-Z].*", said, re.MULTILINE), name


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_no_help_names_a_bound_that_is_not_there(name, capsys):
    main([name, "--help"])
    said = capsys.readouterr().out
    assert "Usage:" in said and "=None" not in said


@pytest.mark.parametrize("runs", [1, 2, 3])
@pytest.mark.parametrize("salt", ["", "pepper"])
def test_a_status_begins_with_the_runs_and_the_last_of_them(runs, salt):
    module = import_module("olne_bench.bench.commands.status")
    data = {"name": "s", "scenarios": ["a"], "sensors": ["full"], "sigmas": [0.1], "seeds": 1}
    suite = Suite.model_validate(data | {"estimators": ["e"], "salt": salt})
    facts = {"suite": suite.model_dump_json(), "started": "then", "executor": "a machine"}
    last = SimpleNamespace(**facts, commit="0123456789abcdef", versions={"olne-bench": "1.2"})
    said = module._heading("mine", [SimpleNamespace()] * (runs - 1) + [last])
    many = {1: "1 run", 2: "2 runs", 3: "3 runs"}[runs]
    assert said.startswith(f"mine: suite s, {many}, the last one of then on a machine, olne-bench")
    assert "olne-bench 1.2, commit 0123456789ab; salt " in said
    assert said.endswith("('pepper')" if salt else "(its own)")
    bare = SimpleNamespace(**facts, commit="", versions={})
    assert "olne-bench ?; salt" in module._heading("mine", [bare])


@pytest.mark.parametrize(
    ("state", "hint"),
    [
        ("missing", "runs missing and stale trials"),
        ("stale", "runs missing and stale trials"),
        ("failed", "--retry failed"),
        ("harness_error", "--retry harness_error"),
    ],
)
def test_a_status_says_what_to_do_next(state, hint):
    module = import_module("olne_bench.bench.commands.status")
    columns = ["missing", "stale", "failed", "harness_error"]
    table = pd.DataFrame([[0] * 4, [0] * 4], columns=columns)
    whole, part = (SimpleNamespace(selection=s) for s in ("", "--seeds 1"))
    assert module._hints(table, whole) == []
    assert module._hints(table, part) == ["the last run was of a part of the suite: --seeds 1"]
    table.loc[1, state] = 2
    (found,) = module._hints(table, whole)
    assert hint in found
