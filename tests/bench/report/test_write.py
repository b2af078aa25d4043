"""The files of a report."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.select import Selection, select
from olne_bench.bench.plan.trial import expand
from olne_bench.bench.report.leaderboard_text import latex, markdown
from olne_bench.bench.report.write import write_report
from olne_bench.bench.run.provenance import provenance
from olne_bench.bench.run.store import open_store
from olne_bench.envs.scenarios import get_scenario
from olne_bench.errors import UserError

TABLES = ("trials", "leaderboard", "scores", "comparisons", "bound_ratios", "calibration")
TABLES += ("identifiability", "identifiability_by_noise", "errors_by_noise")


def fill(folder: Path, scored: bool = True) -> int:
    """Store a run of two estimators that find the truth; return its number of trials."""
    estimators = ("kkt_residual", "uniform")
    part = Selection(scenarios=("two_player",), sigmas=(0.01,), estimators=estimators)
    suite = select(load_suite("quick"), part)
    trials = list(expand(suite))
    weights = get_scenario("two_player").weights
    scores = {"cosine_error": 0.0, "position_error": 0.0}
    source = provenance(
        suite=suite.model_dump_json(), suite_text="", selection=part, seeds=5, executor="here"
    )
    with open_store(folder) as store:
        store.begin_run(source, trials)
        for trial in trials if scored else ():
            outcome = Outcome("ok", "=1+1", scores=scores, weights=weights.tolist())
            store.add(trial, outcome)
    return len(trials)


def test_tables_and_page_are_written(tmp_path: Path) -> None:
    number = fill(tmp_path)
    report = write_report(tmp_path, ())
    files = {path.name for path in tmp_path.iterdir()}
    expected = {f"{name}.csv" for name in TABLES}
    expected |= {"trials.parquet", "leaderboard.md", "leaderboard.tex", "index.html"}
    assert files - {"trials.sqlite", ".lock"} == expected
    board = report.tables.leaderboard
    assert list(board["trials"]) == [5] * 4
    for name, table in report.tables.by_name().items():
        stored = pd.read_csv(tmp_path / f"{name}.csv")
        assert list(stored) == list(table)
        assert len(stored) == len(table)
    text = (tmp_path / "leaderboard.md").read_text(encoding="utf-8")
    assert text == markdown(board, report.study)
    assert (tmp_path / "leaderboard.tex").read_text(encoding="utf-8") == latex(board, report.study)
    assert "kkt_residual" in (tmp_path / "index.html").read_text(encoding="utf-8")
    parquet = pd.read_parquet(tmp_path / "trials.parquet")
    assert len(parquet) == len(pd.read_csv(tmp_path / "trials.csv")) == number
    np.testing.assert_allclose(np.stack(parquet["weights"].iloc[0]).shape, (2, 4))
    # A message is foreign text: a spreadsheet must not read it as a formula.
    assert (parquet["message"] == "=1+1").all()
    assert not pd.read_csv(tmp_path / "trials.csv")["message"].str.startswith("=").any()


def test_a_run_without_a_finished_trial_has_no_report(tmp_path: Path) -> None:
    fill(tmp_path, scored=False)
    before = {path.name for path in tmp_path.iterdir()}
    with pytest.raises(UserError, match="has no finished trial yet"):
        write_report(tmp_path, ())
    assert {path.name for path in tmp_path.iterdir()} == before


def test_what_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    fill(tmp_path)
    (tmp_path / "leaderboard.md").mkdir()
    with pytest.raises(UserError, match=r"leaderboard\.md cannot be written"):
        write_report(tmp_path, ())
