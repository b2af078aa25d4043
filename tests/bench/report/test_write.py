"""The files of a report."""

import json
import sqlite3
import subprocess
import sys
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.judge.observe import sensor_model
from olne_bench.bench.judge.scene import pack_motion, pack_truth
from olne_bench.bench.judge.truth import Draw, true_recording, true_scene
from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.select import Selection, select
from olne_bench.bench.plan.trial import expand
from olne_bench.bench.report.leaderboard_text import latex, markdown
from olne_bench.bench.report.write import write_report
from olne_bench.bench.run.provenance import provenance
from olne_bench.bench.run.store import open_store
from olne_bench.errors import UserError
from olne_bench.games.model.observation import FullView

TABLES = ("trials", "leaderboard", "scores", "comparisons", "bound_ratios", "calibration")
TABLES += ("identifiability", "identifiability_by_noise", "errors_by_noise")


#: A scenario that is a plugin, which is gone when a report is written.
GONE = ScenarioEntry(name="/gone/mine.py:Mine", label="mine")


def fill(folder: Path, scored: bool = True) -> int:
    """Store a run of two estimators that find the truth; return its number of trials."""
    estimators = ("kkt_residual", "kkt_constrained")
    part = Selection(scenarios=("two_player",), sigmas=(0.05,), estimators=estimators)
    suite = select(load_suite("quick"), part)
    draw = Draw.of(suite.scenarios[0], 0, suite.salt)
    trials = [replace(one, scenario=GONE) for one in expand(suite)]
    suite = suite.model_copy(update={"scenarios": (GONE,)})
    scenario = true_recording(draw).scenario
    scene = true_scene(draw, sensor_model(scenario, (FullView(),)))
    scores = {"cosine_error": 0.0, "position_error": 0.0}
    source = provenance(
        suite=suite.model_dump_json(), suite_text="", selection=part, seeds=5, executor="here"
    )
    with open_store(folder) as store:
        store.begin_run(source, trials)
        for trial in trials if scored else ():
            outcome = Outcome("ok", "=1+1", scores=scores, weights=scene.weights.tolist())
            kept = {"scene": pack_truth(scene), "motion": pack_motion(scene.states)}
            store.add(trial, replace(outcome, published_forward=1, **kept))
    return len(trials)


def test_tables_and_page_are_written(tmp_path: Path) -> None:
    number = fill(tmp_path)
    report = write_report(tmp_path, ())
    files = {path.name for path in tmp_path.iterdir()}
    expected = {f"{name}.csv" for name in TABLES}
    expected |= {"trials.parquet", "leaderboard.md", "leaderboard.tex", "index.html"}
    assert files - {"trials.sqlite", ".lock"} == expected
    board = report.tables.leaderboard
    assert list(board["trials"]) == [4] * 4
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


def test_a_report_plays_and_solves_nothing_and_needs_no_plugin(tmp_path: Path, embedded) -> None:
    fill(tmp_path)
    code = (
        "import json, sys; from pathlib import Path\n"
        "from olne_bench.bench.report.write import write_report\n"
        "report = write_report(Path(sys.argv[1]), ('png',))\n"
        "print(json.dumps([report.notes, [*sys.modules]]))"
    )
    said = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], check=True, capture_output=True, text=True
    )
    notes, modules = json.loads(said.stdout)
    used = {name.removeprefix("olne_bench.") for name in modules}
    assert "bench.report.scenes" in used
    assert not used & {"bench.judge.truth", "bench.judge.trials", "games.solve.nearest_root"}
    assert not used & {"games.solve.information", "games.solve.root_following", "mine"}
    assert not [note for note in notes if "trajectories" in note or "known" in note]
    assert len(pd.read_csv(tmp_path / "identifiability.csv")) == 2 * 8
    assert {"trial_mine.png", "scores.png"} <= {
        path.name for path in (tmp_path / "figures").iterdir()
    }
    data = embedded((tmp_path / "index.html").read_text(encoding="utf-8"))
    (scene,) = [one["scene"] for one in data["scenarios"]]
    truth = scene["draws"]["0"]["truth"]
    assert {tuple(map(len, truth))} == {(25, 25)}
    assert [one["paths"] for one in scene["samples"][0]["predictions"]] == [truth] * 4


@pytest.mark.parametrize("table", ["scenes", "motions"])
def test_what_is_damaged_is_said_and_the_rest_is_written(tmp_path: Path, table: str) -> None:
    number = fill(tmp_path)
    column = {"scenes": "content", "motions": "states"}[table]
    with closing(sqlite3.connect(tmp_path / "trials.sqlite")) as connection, connection:
        connection.execute(f"UPDATE {table} SET {column} = zeroblob(9)")
    report = write_report(tmp_path, ())
    assert len(report.tables.leaderboard) == 4 and (tmp_path / "index.html").exists()
    assert sum(report.tables.leaderboard["trials"]) == number
    (line,) = [note for note in report.notes if note.startswith("trajectories of mine")]
    what = {"scenes": "truth", "motions": "motion"}[table]
    assert f"a stored {what} is damaged" in line and line.isprintable()
    assert len(report.tables.identifiability) == (0 if table == "scenes" else 16)
