"""Rows of submissions: read, complete, and compared bit by bit with what is run again."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pyarrow as pa
import pytest
from pyarrow import parquet

from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.outcome import OUTCOME_COLUMNS, Outcome
from olne_bench.bench.plan.trial import Trial, expand
from olne_bench.bench.plan.versions import environment
from olne_bench.bench.report.submission.manifest import ROWS
from olne_bench.bench.report.submission.rows import (
    Rows,
    check_whole,
    described,
    difference,
    explain_versions,
    other_versions,
    read_rows,
    timed_out,
)
from olne_bench.errors import UserError

NAN = float("nan")
OUTCOME = Outcome(
    "ok",
    cosine_limit=0.25,
    published_forward=1,
    solve_seconds=1.0,
    weights=[[0.5, 0.5]],
    scores={"error": 0.1, "unknown": None, "lost": NAN},
)


@pytest.fixture(scope="module")
def trials() -> list[Trial]:
    return [t for t in expand(load_suite("quick"), 2) if t.sigma == 0.05][:4]


def row_of(trial: Trial, outcome: Outcome = OUTCOME) -> dict[str, Any]:
    data = asdict(outcome)
    scores = data.pop("scores")
    versions = {f"{name}_version": code for name, code in asdict(trial.versions).items()}
    return trial.labels | data | versions | scores


def written(folder: Path, rows: list[dict[str, Any]]) -> SimpleNamespace:
    """A submission of these rows."""
    texts = [row | {"weights": row["weights"] and json.dumps(row["weights"])} for row in rows]
    parquet.write_table(pa.Table.from_pylist(texts), folder / ROWS)
    return SimpleNamespace(folder=folder)


def test_rows_are_found_by_their_trial(tmp_path, trials):
    submission = written(tmp_path, [row_of(trial) for trial in trials])
    rows = read_rows(submission)
    assert list(rows.by_key) == [trial.key for trial in trials]
    assert rows.by_key[trials[2].key]["seed"] == trials[2].seed
    assert len(rows.table) == len(trials)
    check_whole(rows, {trial.key: trial for trial in trials}, tmp_path)


@pytest.mark.parametrize("lacking", ["sigma", "weights", "estimator_version"])
def test_a_column_that_is_missing_is_named(tmp_path, trials, lacking):
    row = row_of(trials[0])
    del row[lacking]
    parquet.write_table(pa.Table.from_pylist([row]), tmp_path / ROWS)
    with pytest.raises(UserError, match=f"trials.parquet has no column '{lacking}'"):
        read_rows(SimpleNamespace(folder=tmp_path))


def test_what_is_no_table_is_told_in_one_line(tmp_path):
    (tmp_path / ROWS).write_text("no table\n" * 10)
    with pytest.raises(UserError, match="cannot be read: ") as caught:
        read_rows(SimpleNamespace(folder=tmp_path))
    assert "\n" not in str(caught.value)
    (tmp_path / ROWS).unlink()
    with pytest.raises(UserError, match="cannot be read: "):
        read_rows(SimpleNamespace(folder=tmp_path))


@pytest.mark.parametrize("times", [2, 4])
def test_a_trial_has_one_row(tmp_path, trials, times):
    rows = [row_of(trials[0])] * times + [row_of(trials[1])]
    with pytest.raises(UserError, match=f"has {times - 1} trials more than once"):
        read_rows(written(tmp_path, rows))


def test_rows_are_all_those_and_only_those_that_were_asked_for(tmp_path, trials):
    planned = {trial.key: trial for trial in trials}
    some = Rows(None, {trial.key: row_of(trial) for trial in trials[:2]})
    name = described(row_of(min(trials[2:], key=lambda trial: trial.key)))
    with pytest.raises(UserError) as caught:
        check_whole(some, planned, tmp_path)
    assert str(caught.value) == f"{tmp_path} lacks the row of {name} (2 such in all)"
    more = Rows(None, {trial.key: row_of(trial) for trial in trials})
    with pytest.raises(UserError, match=r"its suite does not ask for: .* \(3 such in all\)"):
        check_whole(more, {trials[0].key: trials[0]}, tmp_path)


def test_a_trial_is_described_by_its_place():
    labels = {"estimator": "a", "scenario": "s", "sensor": "v", "sigma": 0.1, "seed": 3}
    assert described(labels) == "a, s, v, sigma 0.1, seed 3"


def test_versions_of_code_are_compared_one_by_one(trials):
    row = row_of(trials[0])
    assert other_versions(row, trials[0]) == []
    for kind in asdict(trials[0].versions):
        assert other_versions(row | {f"{kind}_version": "other"}, trials[0]) == [kind]


def test_what_differs_between_versions_is_explained_once_for_each_kind():
    here = environment()
    name = min(here)
    there = here | {name: "0.0", "elsewhere": "3.1"}
    submission = SimpleNamespace(runs=[None, SimpleNamespace(environment=there)])
    assert explain_versions([], submission) == ""
    assert explain_versions(["sensor", "estimator", "sensor"], submission) == (
        "the code of the estimator; the code of the sensor"
    )
    said = explain_versions(["environment"], submission)
    pairs = {f"{name} 0.0 there, {here[name]} here", "elsewhere 3.1 there, ? here"}
    assert set(said.split("; ")) == pairs
    del there[name]
    assert f"{name} ? there, {here[name]} here" in explain_versions(["environment"], submission)
    same = SimpleNamespace(runs=[SimpleNamespace(environment=here)])
    assert explain_versions(["environment"], same) == "the environment"


def test_a_row_is_the_same_as_itself(trials):
    assert difference(row_of(trials[0]), OUTCOME) is None


@pytest.mark.parametrize(
    ("change", "column"),
    [
        ({"status": "crash"}, "status"),
        ({"cosine_limit": 0.25 * (1 + 2**-52)}, "cosine_limit"),
        ({"cosine_limit": None}, "cosine_limit"),
        ({"cosine_limit": NAN}, "cosine_limit"),
        ({"published_forward": 0}, "published_forward"),
        ({"weights": [[0.5, 0.25]]}, "weights"),
        ({"weights": None}, "weights"),
        ({"error": 0.2}, "error"),
        ({"error": NAN}, "error"),
        ({"unknown": 0.0}, "unknown"),
        ({"lost": 0.0}, "lost"),
    ],
)
def test_the_last_bit_makes_a_row_another(trials, change, column):
    found = difference(row_of(trials[0]) | change, OUTCOME)
    assert found is not None
    assert found.startswith(f"{column} is ") and " in the submission and " in found


@pytest.mark.parametrize("free", ["solve_seconds", "message", "extras"])
def test_times_and_texts_are_free(trials, free):
    assert difference(row_of(trials[0]) | {free: "other"}, OUTCOME) is None


def test_integers_are_compared_as_numbers(trials):
    assert difference(row_of(trials[0]) | {"published_forward": 1.0}, OUTCOME) is None
    assert {"published_forward", "weights"} <= set(OUTCOME_COLUMNS)


def test_a_time_limit_that_was_met_here_or_there_says_nothing(trials):
    row, late = row_of(trials[0]), replace(OUTCOME, status="timeout")
    assert not timed_out(row, OUTCOME)
    assert timed_out(row, late)
    assert timed_out(row_of(trials[0], late), OUTCOME)
    assert difference(row | {"error": 9.0}, late) is None
    assert difference(row_of(trials[0], late), OUTCOME) is None


@pytest.mark.parametrize(("length", "shown"), [(120, 120), (121, 120), (5000, 120)])
def test_long_values_are_cut(trials, length, shown):
    row = row_of(trials[0]) | {"status": "x" * length}
    found = difference(row, OUTCOME)
    assert found is not None
    there = found.removeprefix("status is ").removesuffix(" in the submission and ok here")
    assert len(there) == shown
    assert there.endswith("..." if length > shown else "x")
    lists = difference(row_of(trials[0]) | {"weights": [[1.0]]}, OUTCOME)
    assert lists == "weights is [[1.0]] in the submission and [[0.5, 0.5]] here"
