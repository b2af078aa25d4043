"""Acceptance limits and comparisons of runs, as a project's CI would call them."""

import sqlite3
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from olne_bench.bench.commands import compare
from olne_bench.bench.commands.cli import main
from olne_bench.bench.commands.compare import _names as compared_names
from olne_bench.bench.judge.metrics import BUILT_IN
from olne_bench.bench.plan.select import Selection
from olne_bench.bench.plan.suite import GateLimits, salt_id
from olne_bench.bench.report.gate import check_limits
from olne_bench.bench.report.statistics.pairs import compare_runs
from olne_bench.bench.report.study import Study
from olne_bench.bench.run.store import open_store
from olne_bench.errors import UserError
from tests.bench.report.conftest import trial_row

SUITE = """
name = "small"
scenarios = ["two_player"]
sensors = ["full", "partial"]
sigmas = [0.05]
seeds = 12
estimators = ["kkt_residual", "uniform"]
"""
GATE = """
[gate.kkt_residual]
sensors = ["full"]
cosine_error = 0.9
failures = 12
time_ratio = 100000
time_reference = "uniform"
"""
INF, NAN = float("inf"), float("nan")


def call(*arguments: object) -> int:
    with pytest.raises(SystemExit) as caught:
        main([str(argument) for argument in arguments])
    return int(caught.value.code or 0)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("gate")
    suite = folder / "small.toml"
    suite.write_text(SUITE + GATE)
    main(["run", str(suite), "--out", str(folder / "run"), "--no-figures", "--jobs", "1"])
    return folder / "run"


def test_every_report_comes_with_the_page_and_tables(run):
    for name in ("index.html", "leaderboard.md", "leaderboard.tex", "scores.csv"):
        assert (run / name).stat().st_size > 200
    assert len(pd.read_csv(run / "identifiability.csv")) == 2 * 8
    board = pd.read_csv(run / "leaderboard.csv")
    own = board[board["estimator"] == "kkt_residual"]
    assert own["position_error_score"].tolist() == [1.0, 1.0]  # it is the reference here
    assert board["estimator"].tolist() == ["kkt_residual", "uniform"] * 2  # the floor is last


def test_the_page_plays_what_is_asked_for(run, capsys, embedded):
    main(["report", str(run), "--no-figures", "--play", "0.05:9", "--play", "0.05:11"])
    html = (run / "index.html").read_text()
    samples = embedded(html)["scenarios"][0]["scene"]["samples"]
    assert {9, 11} <= {sample["seed"] for sample in samples}
    capsys.readouterr()
    assert call("report", run, "--no-figures", "--play", "0.3:1") == 2
    said = capsys.readouterr().err
    assert "--play 0.3:1: the run has no such trial; it has the noise levels 0.05 and seeds" in said
    assert call("report", run, "--play", "high") == 2
    assert "expected SIGMA:SEED, such as 0.05:3" in capsys.readouterr().err


def test_two_runs_on_one_page(run, tmp_path, capsys):
    page = tmp_path / "both.html"
    words = ("compare", run, run, "--estimator", "uniform=kkt_residual", "--page", page)
    assert call(*words) == 1  # equal weights are the truth of two_player
    assert f"{page}: both runs on one page" in capsys.readouterr().out
    assert "What got better or worse" in page.read_text()
    assert "uniform → kkt_<wbr>residual" in page.read_text()
    assert call(*words) == 2
    assert "exists already" in capsys.readouterr().err


def test_limits_that_are_kept(run, capsys):
    assert call("gate", run) == 0
    said = capsys.readouterr().out
    assert said.count("holds") == 3
    assert "3 of 3 limits hold" in said


def test_a_limit_that_is_not_kept(run, tmp_path, capsys):
    suite = tmp_path / "strict.toml"
    suite.write_text(SUITE + "[gate.kkt_residual]\ncosine_error = 1e-9\n")
    assert call("gate", run, "--suite", suite) == 1
    said = capsys.readouterr().out
    assert said.count("FAILS  kkt_residual, two_player") == 2


@pytest.mark.parametrize(
    ("gate", "expected"),
    [
        ("", "has no [gate] table"),
        ("[gate.kkt_residual]\nerror = 1\n", "limits 'error', which is not a metric of the run"),
        ("[gate.kkt_residual]\ncosine_error = -1\n", "greater than or equal to 0"),
        ("[gate.kkt_residual]\ntime_ratio = 2\n", "time_ratio and time_reference belong together"),
        ("[gate.kkt_residual]\nsensors = ['full']\n", "no limit is set; limits are those"),
        ("[gate.nobody]\nfailures = 0\n", "the run has none; it has: kkt_residual, uniform"),
        ("[gate.uniform]\nfailures = 0\nsensors = ['x']\n", "it has: full, partial"),
    ],
)
def test_bad_gates_are_one_line(run, tmp_path, capsys, gate, expected):
    suite = tmp_path / "bad.toml"
    suite.write_text(SUITE + gate)
    assert call("gate", run, "--suite", suite) == 2
    error = capsys.readouterr().err.strip()
    assert expected in error and "\n" not in error


@pytest.mark.parametrize(("limit", "passed"), [("score", True), ("cosine_error_score", False)])
def test_scores_can_be_limited(limit, passed):
    table = pd.DataFrame({"scenario": ["s"], "sensor": ["v"], "estimator": ["e"], "trials": [3]})
    table = table.assign(position_error_score=0.8, cosine_error_score=1.2)
    (check,) = check_limits(table, {"e": GateLimits.model_validate({limit: 1.0})})
    assert check.passed == passed


def test_what_is_not_known_does_not_pass():
    table = pd.DataFrame(
        {"scenario": ["s"], "sensor": ["v"], "estimator": ["e"], "trials": [3]}
        | {"limit_ratio": [float("nan")], "solve_seconds_median": [0.1]}
    )
    (check,) = check_limits(table, {"e": GateLimits(limit_ratio=5.0)})
    assert not check.passed


@pytest.mark.parametrize(
    ("own", "reference", "ratio"), [(4.0, 2.0, 2.0), (INF, 2.0, INF), (4.0, INF, NAN)]
)
def test_times_without_an_end_do_not_pass(own, reference, ratio):
    table = pd.DataFrame({"estimator": ["e", "r"], "solve_seconds_median": [own, reference]})
    table = table.assign(scenario="s", sensor="v", trials=3)
    (check,) = check_limits(table, {"e": GateLimits(time_ratio=3.0, time_reference="r")})
    assert check.value == pytest.approx(ratio, nan_ok=True)
    assert check.passed == (ratio == 2)


def test_a_run_is_the_same_as_itself(run, tmp_path, capsys):
    out = tmp_path / "changes.csv"
    assert call("compare", run, run, "--out", out) == 0
    printed = capsys.readouterr().out
    assert "0 better, 12 same, 0 worse" in printed
    lines = {row.split()[1]: row for row in printed.splitlines() if "two_player" in row}
    assert "0 of 12 -> 0 of 12" in lines["failures"]
    median = pd.read_csv(out).set_index("error")["before"]["cosine_error"].iloc[-1]
    assert f"{median:.3g} -> {median:.3g}" in lines["cosine_error"]
    assert (pd.read_csv(out)["p_holm"] == 1).all()


def test_another_estimator_is_better_one_way_and_worse_the_other(run, capsys):
    assert call("compare", run, run, "--estimator", "uniform=kkt_residual") == 1
    assert "0 better, 2 same, 4 worse" in capsys.readouterr().out
    assert call("compare", run, run, "--estimator", "kkt_residual=uniform") == 0
    assert "4 better, 2 same, 0 worse" in capsys.readouterr().out


def test_bad_comparisons_are_one_line(run, tmp_path, capsys):
    assert call("compare", run, tmp_path) == 2
    assert "no run in" in capsys.readouterr().err
    assert call("compare", run, run, "--estimator", "uniform=x") == 2
    assert "has no 'x'; it has: kkt_residual, uniform" in capsys.readouterr().err


def test_a_comparison_is_a_line_of_words_and_numbers():
    row = {"verdict": "same", "error": "position_error", "scenario": "s", "sensor": "v"}
    row |= {"estimator": "a", "other": "a", "pairs": 8, "before": 0.5, "after": 0.25}
    row |= {"better": 0.75, "better_low": 0.4, "better_high": 0.9, "p_holm": 0.123}
    few = row | {"error": "failures", "other": "b", "before": 0.125, "better_low": NAN}
    text = compare._format(pd.DataFrame([row, few]))
    _, first, second = (" ".join(line.split()) for line in text.splitlines())
    assert first == "same position_error s v a 0.5 -> 0.25 75.0 % [40.0, 90.0] 0.12 8"
    assert second == "same failures s v a -> b 1 of 8 -> 2 of 8 75.0 % 0.12 8"


def test_estimators_that_are_gone_are_named():
    def trials(*names, seeds=1, suite="x"):
        rows = [(suite, "s", "v", 0.1, seed, name) for name in names for seed in range(seeds)]
        columns = ["suite", "scenario", "sensor", "sigma", "seed", "estimator"]
        return pd.DataFrame(rows, columns=columns)

    def notes(old, new, names):
        same = {name: name for name in names}
        return compare._notes(old, new, same, Path("one"), Path("two"))

    old = trials("a", "b", "c", seeds=2)
    assert notes(old, old, "abc") == []
    assert notes(old, trials("a", "b", seeds=2), "ab") == ["two has no c"]
    assert notes(old, trials("a", "b", "c", seeds=2), "ab") == []  # it was not asked for
    assert notes(old, trials("a", seeds=2), "a") == []  # one alone was chosen
    assert notes(old, trials("a", "b", "c"), "ab") == ["2 of 4 trials in one are not in two"]
    (note,) = notes(old, trials("a", "b", seeds=2, suite="y"), "a")
    assert note == "one is a run of suite x, two of y; only trials that both have are compared"


def test_an_estimator_is_looked_for_in_its_own_run():
    old, new = (pd.DataFrame({"estimator": [name, "both"]}) for name in ("old", "new"))
    places = Path("before"), Path("after")
    assert compared_names((), old, new, *places) == {"both": "both"}
    assert compared_names(("old=new", "both"), old, new, *places) == {"old": "new", "both": "both"}
    for text, said in (("new", "before has no 'new'"), ("old", "after has no 'old'")):
        with pytest.raises(UserError, match=said):
            compared_names((text,), old, new, *places)


def test_a_new_failure_is_worse():
    before = pd.DataFrame([trial_row(scenario="two_player", seed=k) for k in range(20)])
    after = before.assign(status=["crash"] * 12 + ["ok"] * 8)
    table = compare_runs(before, after, {"e": "e"})
    assert (table["verdict"] == "worse").all()
    after = table.set_index("error")["after"]
    assert after["cosine_error"] == after["position_error"] == float("inf")
    assert after["failures"] == 0.6


def test_small_gains_do_not_make_up_for_new_failures():
    """28 of 40 trials are slightly better, 12 crash: more trials gain, but failures are worse."""
    before = pd.DataFrame([trial_row(scenario="two_player", seed=k) for k in range(40)])
    after = before.assign(
        status=["crash"] * 12 + ["ok"] * 28, cosine_error=0.099, position_error=0.99
    )
    table = compare_runs(before, after, {"e": "e"}).set_index("error")
    assert table["verdict"].to_dict() == {
        "cosine_error": "better",
        "position_error": "better",
        "failures": "worse",
    }
    assert table.loc["failures", "p"] == pytest.approx(2 * 0.5**12)
    assert table.loc["failures", ["before", "after"]].tolist() == [0.0, 0.3]


def test_a_part_of_a_suite_does_not_pass_for_the_whole(tmp_path, capsys):
    suite = tmp_path / "small.toml"
    suite.write_text(SUITE.replace("seeds = 12", "seeds = 2") + GATE)
    out = tmp_path / "run"
    command = ["run", str(suite), "--out", str(out), "--no-report", "--jobs", "1"]
    main([*command, "--seeds", "1"])
    assert call("gate", out) == 0
    assert "; only a part of the suite was run: --seeds 1" in capsys.readouterr().out
    with open_store(out) as store:  # as if a complete run had done only that
        (source,) = store.runs()
        store.begin_run(replace(source, selection=Selection(), seeds=2), [])
    assert call("gate", out) == 1
    said = capsys.readouterr().out
    assert "FAILS  kkt_residual, two_player, full: 1 of 2 trials are done" in said
    assert "but the run is not finished" in said
    main(command)
    assert call("gate", out) == 0


def test_limits_of_scenarios_and_estimators_are_not_missed(tmp_path, capsys):
    """Only a scenario's own noise levels and draws had to be run."""
    suite = tmp_path / "small.toml"
    suite.write_text(
        SUITE.replace('["two_player"]', '[{name = "two_player", sigmas = [0.0, 0.05], seeds = 2}]')
        .replace('["kkt_residual", "uniform"]', '[{name = "kkt_residual", seeds = 1}, "uniform"]')
        .replace("sigmas = [0.05]", "sigmas = [0.01, 0.02, 0.05]")
        + GATE
    )
    out = tmp_path / "run"
    main(["run", str(suite), "--out", str(out), "--no-report", "--jobs", "1"])
    assert call("gate", out) == 0
    assert "3 of 3 limits hold\n" in capsys.readouterr().out


def lose(folder, condition):
    with sqlite3.connect(folder / "trials.sqlite") as connection:
        connection.execute(f"DELETE FROM trials WHERE {condition}")
    connection.close()


def test_a_selection_has_to_be_done_as_well(tmp_path, capsys):
    suite = tmp_path / "small.toml"
    suite.write_text(SUITE.replace("seeds = 12", "seeds = 2") + GATE)
    halves = tmp_path / "a", tmp_path / "b"
    for half, sensor in zip(halves, ("full", "partial"), strict=True):
        command = ["run", str(suite), "--out", str(half), "--no-report", "--jobs", "1"]
        main([*command, "--sensor", sensor])
    assert call("gate", halves[0]) == 0
    lose(halves[1], "estimator = 'kkt_residual' AND seed = 1")
    lacking = "FAILS  kkt_residual, two_player, partial: 1 of 2 trials are done"
    gate = tmp_path / "gate.toml"
    gate.write_text(SUITE + "[gate.kkt_residual]\nfailures = 12\n")
    assert call("gate", halves[1], "--suite", gate) == 1
    assert lacking in capsys.readouterr().out
    main(["merge", *map(str, halves), "--out", str(tmp_path / "whole")])
    assert call("gate", tmp_path / "whole") == 1
    said = capsys.readouterr().out
    assert lacking in said
    assert "; only a part of the suite was run: --sensor full; --sensor partial" in said


def test_what_a_comparison_does_not_see_is_said(run, tmp_path, capsys):
    suite = tmp_path / "other.toml"
    suite.write_text(SUITE.replace("small", "other").replace("seeds = 12", "seeds = 3"))
    main(["run", str(suite), "--out", str(tmp_path / "b"), "--no-report", "--jobs", "1"])
    capsys.readouterr()
    assert call("compare", run, tmp_path / "b") == 0
    said = capsys.readouterr().err
    assert "is a run of suite small" in said and "of other; only trials" in said
    assert "36 of 48 trials in" in said
    assert "pairs of trials share their noise level, not their noise" in said


def test_what_both_runs_have_is_compared_with_the_first_ones_salt():
    position, cosine = BUILT_IN[:2]
    one = Study((position, cosine), {"a": 1}, {"s": 1}, "salt", {"e": 1})
    other = Study((cosine,), {"b": 2}, {"s": 2, "t": 2}, "pepper", {"f": 2})
    both = compare._common(one, other)
    assert both.metrics == (cosine,)
    assert (both.scenarios, both.sensors) == ({"a": 1, "b": 2}, {"s": 2, "t": 2})
    assert (both.salt, both.estimators) == ("salt", {"e": 1, "f": 2})
    assert compare._common(other, one).metrics == (cosine,)


def test_other_noise_is_told_by_the_salts_ids():
    runs = [
        compare._Run(Path(name), pd.DataFrame(), Study(salt=salt), [], pd.DataFrame())
        for name, salt in (("one", "salt"), ("two", "salt"), ("three", "pepper"))
    ]
    assert compare._other_noise(runs[0], runs[1]) == []
    (note,) = compare._other_noise(runs[0], runs[2])
    ids = salt_id("salt"), salt_id("pepper")
    assert note.startswith(f"one has the salt {ids[0]}, three {ids[1]}: pairs of trials share")


@pytest.mark.parametrize(
    ("verdicts", "code"), [(["same"], 0), (["better", "same"], 0), (["worse", "better"], 1)]
)
def test_a_comparison_ends_with_what_got_worse(monkeypatch, capsys, tmp_path, verdicts, code):
    table = pd.DataFrame({"verdict": verdicts})
    trials = pd.DataFrame({"estimator": ["e"], "scenario": ["s"], "sensor": ["f"]})
    standing = pd.DataFrame({"estimator": ["e"], "scenario": ["s"], "sensor": ["f"]})
    standing = standing.assign(standing="ranks", implausible=0)
    asked = []
    monkeypatch.setattr(compare, "_read", lambda f: compare._Run(f, trials, Study(), [], standing))
    monkeypatch.setattr(compare, "compare_runs", lambda *given: asked.append(given) or table)
    monkeypatch.setattr(compare, "_format", lambda _: "a table")
    monkeypatch.setattr(compare, "_notes", lambda *_: ["a note"])
    assert call("compare", "one", "two", "--out", tmp_path / "out.csv") == code
    said = capsys.readouterr()
    assert said.err == "note: a note\n"
    counts = ", ".join(f"{verdicts.count(v)} {v}" for v in ("better", "same", "worse"))
    assert said.out == f"a table\n{counts}\n"
    assert pd.read_csv(tmp_path / "out.csv")["verdict"].tolist() == verdicts
    assert asked[0][2] == {"e": "e"}
    assert call("compare", "one", "two", "--out", tmp_path / "none" / "out.csv") == 2
    assert "there is no folder" in capsys.readouterr().err
    assert call("compare", "one", "two", "--out", tmp_path / "out.csv") == 2
    assert "exists already" in capsys.readouterr().err
    table = table.iloc[:0]
    assert call("compare", "one", "two") == 2
    assert "one and two have no trial with noise in common" in capsys.readouterr().err
