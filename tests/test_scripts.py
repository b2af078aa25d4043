"""Scripts that nothing else runs keep working: rivals of the solvers, and rows run again."""

import importlib
import shutil
from pathlib import Path

import pandas as pd
import pytest

from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import KEY_COLUMNS
from olne_bench.envs.scenarios import get_scenario
from olne_bench.games.solve.olne import solve_olne

SCRIPTS = Path(__file__).parents[1] / "scripts"
RESULTS = SCRIPTS.parent / "results"


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(SCRIPTS)
    return importlib.import_module


def test_rivals_find_the_optimum_of_the_joint_method(script):
    scenario = get_scenario("two_player")
    truth = solve_olne(scenario.game, scenario.weights, scenario.initial_state)
    measured = script("perf").measure_inverse(scenario, truth, sequences=1)
    for name in ("published", "compact"):
        assert measured[name]["sequences"] == 8
        assert measured[name]["ours same or lower"] == 1.0
    least = [row["ours objective"] for row in measured["rows"]]
    rival = [row["compact objective"] for row in measured["rows"]]
    assert (
        sum(one == pytest.approx(other, rel=1e-6) for one, other in zip(least, rival, strict=True))
        >= 6
    )


def test_a_row_that_is_run_again_is_compared_number_by_number(script, capsys):
    stored = script("stored_rows")
    trial = type("Trial", (), {"key": ("a",), "labels": dict.fromkeys(KEY_COLUMNS, "a")})
    columns = dict.fromkeys((*KEY_COLUMNS, "status", "cosine_error", "motion"), "double")
    known = {
        stored._key(trial.labels, columns): {"status": "ok", "cosine_error": 0.5, "motion": b"x"}
    }
    same = [(trial, Outcome("ok", scores={"cosine_error": 0.5, "motion": b"x"}))]
    assert not stored._differ(known, same, columns)
    rounded = [(trial, Outcome("ok", scores={"cosine_error": 0.5 + 1e-9, "motion": b"x"}))]
    assert stored._differ(known, rounded, columns)
    assert not stored._differ(known, rounded, {**columns, "cosine_error": "float"})
    more = [(trial, Outcome("ok", scores={"cosine_error": 0.5, "motion": b"x", "crps": 1.0}))]
    assert stored._differ(known, more, columns)  # a column that the whole table lacks
    other = [(trial, Outcome("ok", scores={"cosine_error": 0.25, "motion": b"y"}))]
    capsys.readouterr()
    assert stored._differ(known, other, columns)
    printed = capsys.readouterr().out
    assert "cosine_error: 1 rows differ, relatively by 0.5 in the median" in printed
    assert "motion: 1 rows differ" in printed


def test_rows_of_the_results_run_again(script, capsys):
    kept = pd.read_parquet(RESULTS / "sensors/trials.parquet")
    script("stored_rows").repeat(RESULTS / "sensors/trials.parquet", "sensors", number=3, jobs=1)
    printed = capsys.readouterr().out
    assert len(kept) >= 3 and "3 rows; equal in all: " in printed
    assert "scene" not in printed and "motion" not in printed  # these enter no table
    assert "status" in printed.partition("equal in all: ")[2].partition("\n")[0]


def test_rows_of_a_small_table_run_again(script, capsys, tmp_path):
    """It has no parameters, single precision, and before it told it, no environment."""
    table, older = RESULTS / "parameters/trials.parquet", tmp_path / "trials.parquet"
    rows = pd.read_parquet(table)
    rows.drop(columns=[name for name in rows if name.endswith("_version")]).to_parquet(older)
    given = {"estimator": ("uniform",), "number": 3, "jobs": 1}
    for kept, environment in ((table, rows["environment_version"].iloc[0]), (older, "not told")):
        script("stored_rows").repeat(kept, "parameters", **given)
        printed = capsys.readouterr().out
        assert "3 rows; equal in all: " in printed
        assert f"environment of the rows: {environment}" in printed
        assert "cosine_error" in printed.partition("equal in all: ")[2].partition("\n")[0]


def test_scenarios_that_were_run_again_take_the_place_of_kept_ones(script, tmp_path):
    grown = script("grown_results")
    kept, new = tmp_path / "kept.csv", pd.DataFrame({"scenario": ["b"], "error": [3.0]})
    assert grown.grown(new, kept, ["scenario"]) is new
    pd.DataFrame({"scenario": ["a", "b", "b"], "error": [1.0, 2.0, 2.5]}).to_csv(kept)
    found = grown.grown(new, kept, ["scenario"])[["scenario", "error"]]
    assert found.values.tolist() == [["a", 1.0], ["b", 3.0]]


def test_boards_of_a_part_are_those_of_the_whole_again(script, tmp_path):
    """The board of all kept rows, a scenario of which seems to be new, does not change."""
    run, out = tmp_path / "constrained", tmp_path / "out"
    run.mkdir()
    shutil.copytree(RESULTS / "constrained", out)
    for name in ("leaderboard.csv", "errors_by_noise.csv", "scores.csv"):
        table = pd.read_csv(out / name)
        table[table["scenario"] == "merging"].to_csv(run / name, index=False)
    script("grown_results").grow_boards(run, out, pd.read_parquet(out / "trials.parquet"))
    for name in ("leaderboard.csv", "scores.csv", "errors_by_noise.csv"):
        known, found = (pd.read_csv(folder / name) for folder in (RESULTS / "constrained", out))
        key = [label for label in ("error", *KEY_COLUMNS) if label in known]
        if name == "scores.csv":  # by errors that are not kept, over all scenarios, there are none
            again = found.loc[found["scenario"] == "all", "error"]
            assert {"position_error", "cosine_error"} <= set(again)
            known = known[(known["scenario"] != "all") | known["error"].isin(again)]
        known, found = (table.set_index(key).sort_index() for table in (known, found))
        assert len(known) == len(found)
        known = known.loc[found.index]  # rows without a level of noise have no order
        pd.testing.assert_frame_equal(known, found[known.columns], rtol=1e-5)
