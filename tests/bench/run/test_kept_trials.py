"""``scripts/kept_trials.py``: a run folder comes back from its file."""

import runpy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.select import Selection, select
from olne_bench.bench.plan.trial import Trial, expand
from olne_bench.bench.run.provenance import Provenance
from olne_bench.bench.run.resume import Stored, pending
from olne_bench.bench.run.store import open_store, read_store

SCRIPT = Path(__file__).parents[3] / "scripts" / "kept_trials.py"
SOURCE = Provenance("", "{}", "", Selection(), 1, "", {}, {}, "", {})


@pytest.fixture(scope="module")
def script() -> dict[str, Callable[..., Any]]:
    return runpy.run_path(str(SCRIPT))


@pytest.fixture
def trials() -> list[Trial]:
    part = Selection(scenarios=("two_player",), estimators=("uniform", "kkt_residual"))
    return list(expand(select(load_suite("quick"), part), seeds=1))


@pytest.fixture
def folder(tmp_path: Path, trials: list[Trial]) -> Path:
    outcome = Outcome(
        "ok",
        "fine",
        extras='{"a": 1}',
        scores={"cosine_error": 0.1},
        weights=[[0.3, 0.7]] * 2,
        trial_seconds=2.0,
    )
    with open_store(tmp_path / "run") as store:
        store.begin_run(SOURCE, trials)
        for trial in trials:
            store.add(trial, outcome)
    return tmp_path / "run"


def test_rows_and_their_run_come_back(script, tmp_path, folder, trials):
    file, again = tmp_path / "kept.parquet", tmp_path / "again"
    kept = [trial for trial in trials if trial.estimator.label == "kkt_residual"]
    assert 0 < len(kept) < len(trials)
    assert script["keep"](folder, file, ["kkt_residual"]) == len(kept)
    assert script["restore"](file, again) == len(kept)
    with read_store(folder) as before, read_store(again) as after:
        rows = before.frame().query("estimator == 'kkt_residual'").reset_index(drop=True)
        back = after.frame()
        assert after.runs() == before.runs()
        cost = before.costs()["two_player", "kkt_residual"]
        assert after.costs() == {("two_player", "kkt_residual"): cost}
    exact = [name for name in rows if rows[name].dtype != float and name != "weights"]
    assert back[exact].equals(rows[exact])
    np.testing.assert_allclose(back["cosine_error"], 0.1, rtol=1e-7)
    np.testing.assert_allclose(np.array(back["weights"][0]), [[0.3, 0.7]] * 2, rtol=1e-7)


def test_a_run_goes_on_with_what_is_missing(script, tmp_path, folder, trials):
    file, again = tmp_path / "kept.parquet", tmp_path / "again"
    script["keep"](folder, file, ["kkt_residual"])
    script["restore"](file, again)
    with read_store(again) as store:
        missing = list(pending(trials, Stored(store.records())))
    assert {trial.estimator.label for trial in missing} == {"uniform"}


def test_two_halves_merge(script, tmp_path, folder, trials):
    for name in ("kkt_residual", "uniform"):
        script["keep"](folder, tmp_path / name, [name])
        script["restore"](tmp_path / name, tmp_path / f"{name} again")
    with open_store(tmp_path / "kkt_residual again") as store:
        new, known = store.merge(tmp_path / "uniform again" / "trials.sqlite")
        assert len(store.table()) == len(trials)
    assert (new, known) == (len(trials) // 2, 0)


def test_a_run_is_not_overwritten(script, tmp_path, folder):
    script["keep"](folder, tmp_path / "kept.parquet", ["kkt_residual"])
    with pytest.raises(SystemExit, match="holds a run already"):
        script["restore"](tmp_path / "kept.parquet", folder)
