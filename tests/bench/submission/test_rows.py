"""Rows of submissions: read, complete, and compared bit by bit with what is run again."""

import io
import re
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pandas as pd
import pyarrow as pa
import pytest
from pyarrow import parquet

from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.outcome import NESTED, OUTCOME_COLUMNS, Outcome
from olne_bench.bench.plan.trial import LABEL_COLUMNS, Trial, expand
from olne_bench.bench.plan.versions import VERSION_COLUMNS, environment, environment_version
from olne_bench.bench.run.store_table import NUMBERS, schema_of
from olne_bench.bench.submission.manifest import ROWS
from olne_bench.bench.submission.rows import (
    Rows,
    check_versions,
    check_whole,
    described,
    difference,
    explain_versions,
    read_rows,
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


@pytest.fixture(autouse=True)
def here(monkeypatch) -> None:
    """Files are read in this process, which is faster (``test_parquet_rows`` has the other)."""

    def read(data: bytes, place: Path) -> pa.Table:
        try:
            return parquet.read_table(io.BytesIO(data))
        except pa.ArrowException as error:
            raise UserError(f"{place} cannot be read: {error}") from error

    monkeypatch.setattr("olne_bench.bench.submission.rows.read_parquet", read)


@pytest.fixture(scope="module")
def trials() -> list[Trial]:
    return [t for t in expand(load_suite("paper"), 2) if t.sigma == 0.05][:4]


def row_of(trial: Trial, outcome: Outcome = OUTCOME) -> dict[str, Any]:
    data = asdict(outcome)
    scores = data.pop("scores")
    versions = {f"{name}_version": code for name, code in asdict(trial.versions).items()}
    return trial.labels | data | versions | scores


def table_of(rows: list[dict[str, Any]]) -> pa.Table:
    usual = schema_of(LABEL_COLUMNS | OUTCOME_COLUMNS | VERSION_COLUMNS)
    types = {field.name: NUMBERS if field.name in NESTED else field.type for field in usual}
    schema = pa.schema([*(types | dict.fromkeys(OUTCOME.scores, pa.float64())).items()])
    return pa.Table.from_pylist(rows, schema)


def written(folder: Path, rows: list[dict[str, Any]]) -> Any:
    """A submission of these rows."""
    parquet.write_table(table_of(rows), folder / ROWS)
    return SimpleNamespace(folder=folder)


def rows_of(trials: list[Trial], **changes: Any) -> Rows:
    """Rows of trials, as they are read; changes concern the last one."""
    rows = [row_of(trial) for trial in trials]
    rows[-1] |= changes
    places = {trial.key: k for k, trial in enumerate(trials)}
    return Rows(pd.DataFrame(), table_of(rows), places)


def test_rows_are_found_by_their_trial(tmp_path, trials):
    rows = read_rows(written(tmp_path, [row_of(trial) for trial in trials]))
    assert list(rows.places) == [trial.key for trial in trials]
    assert rows.row(trials[2].key)["seed"] == trials[2].seed
    assert rows.row(trials[2].key)["weights"] == [[0.5, 0.5]]
    assert len(rows.table) == len(trials)
    check_whole(rows, {trial.key: trial for trial in trials}, tmp_path)


def test_where_there_are_no_rows_it_is_said(tmp_path):
    with pytest.raises(UserError, match="trials.parquet is missing"):  # noqa: RUF043
        read_rows(SimpleNamespace(folder=tmp_path))
    (tmp_path / ROWS).write_text("no table")
    with pytest.raises(UserError, match="trials.parquet cannot be read"):  # noqa: RUF043
        read_rows(SimpleNamespace(folder=tmp_path))
    with pytest.raises(UserError, match="has no row"):
        read_rows(written(tmp_path, []))


@pytest.mark.parametrize("times", [2, 4])
def test_a_trial_has_one_row(tmp_path, trials, times):
    rows = [row_of(trials[0])] * times + [row_of(trials[1])]
    with pytest.raises(UserError, match=f"has {times - 1} trials more than once"):
        read_rows(written(tmp_path, rows))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"status": "OK"}, "has the status 'OK'; known: ok, not_converged"),
        ({"status": "x" * 5000}, "has the status 'xxx"),
        ({"status": None}, "has a row without status"),
        ({"status": "harness_error"}, "has trials that could not be judged"),
        ({"sigma": None}, "has a row without sigma"),
        ({"count": None}, "has a row without count"),
        ({"estimator_version": None}, "has a row without estimator_version"),
        ({"error": float("inf")}, "has an infinite error"),
        ({"cosine_limit": float("-inf")}, "has an infinite cosine_limit"),
        ({"sigma": float("inf")}, "has an infinite sigma"),
        ({"solve_seconds": -1.0}, "has a negative time, -1 s"),
        ({"weights": []}, "has weights that are not a table of finite numbers"),
        ({"weights": [[]]}, "has weights that are not a table"),
        ({"weights": [[0.5], [0.5, 0.5]]}, "has weights that are not a table"),
        ({"weights": [[0.5, 0.5], None]}, "has weights that are not a table"),
        ({"weights": [[0.5, None]]}, "has weights that are not a table"),
        ({"weights": [[0.5, NAN]]}, "has weights that are not a table"),
        ({"unknowns": [[float("inf")]]}, "has unknowns that are not a table"),
        ({"weight_levels": [[NAN]]}, "has weight_levels that are not a table"),
    ],
)
def test_values_that_no_trial_has_are_refused(tmp_path, trials, changes, said):
    rows = [row_of(trial) for trial in trials]
    rows[1] |= changes
    with pytest.raises(UserError, match=re.escape(f"trials.parquet {said}")) as caught:
        read_rows(written(tmp_path, rows))
    assert len(str(caught.value)) < 400


def test_rows_are_all_those_and_only_those_that_were_asked_for(tmp_path, trials):
    planned = {trial.key: trial for trial in trials}
    name = described(min(trials[2:], key=lambda trial: trial.key).labels)
    with pytest.raises(UserError) as caught:
        check_whole(rows_of(trials[:2]), planned, tmp_path)
    assert str(caught.value) == f"{tmp_path} lacks the row of {name} (2 such in all)"
    with pytest.raises(UserError, match=r"its suite does not ask for: .* \(3 such in all\)"):
        check_whole(rows_of(trials), {trials[0].key: trials[0]}, tmp_path)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"count": -5}, "count is -5 and not 1 in the row of"),
        ({"count": 10**9}, "count is 1000000000 and not 1"),
        ({"suite": "x" * 5000}, "suite is xxx"),
    ],
)
def test_rows_count_as_often_as_their_suite_says(tmp_path, trials, changes, said):
    planned = {trial.key: trial for trial in trials}
    with pytest.raises(UserError, match=said):
        check_whole(rows_of(trials, **changes), planned, tmp_path)


def manifest_of(*environments: Mapping[str, str]) -> Any:
    return SimpleNamespace(
        folder=Path("mine"), runs=[SimpleNamespace(environment=one) for one in environments]
    )


def test_versions_are_those_of_the_manifest(trials):
    planned = {trial.key: trial for trial in trials}
    here = environment()
    assert check_versions(rows_of(trials), planned, manifest_of(here)) == set()
    other = here | {"numpy": "0.1"}
    assert check_versions(rows_of(trials), planned, manifest_of(other, here)) == set()
    with pytest.raises(UserError, match="^mine: environment_version of .* does not follow from"):  # noqa: RUF043
        check_versions(rows_of(trials), planned, manifest_of(other))
    for version in ("other", environment_version(other)):
        with pytest.raises(UserError, match=f"is {version}, which does not follow"):
            changed = rows_of(trials, environment_version=version)
            check_versions(changed, planned, manifest_of(here))
    rows = [row_of(t) | {"environment_version": environment_version(other)} for t in trials]
    changed = Rows(pd.DataFrame(), table_of(rows), rows_of(trials).places)
    assert check_versions(changed, planned, manifest_of(other)) == {"environment"}


@pytest.mark.parametrize("kind", ["estimator", "scenario", "sensor", "scoring"])
def test_rows_of_one_thing_are_of_one_code(trials, kind):
    planned = {trial.key: trial for trial in trials}
    alone = rows_of(trials, **{f"{kind}_version": "other"})
    with pytest.raises(UserError, match=f"{kind}_version of .* is other, which does not follow"):
        check_versions(alone, planned, manifest_of(environment()))
    rows = [row_of(trial) | {f"{kind}_version": "other"} for trial in trials]
    everywhere = Rows(pd.DataFrame(), table_of(rows), alone.places)
    assert check_versions(everywhere, planned, manifest_of(environment())) == {kind}


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


@pytest.mark.parametrize(
    "free",
    [
        *({}, {"solve_seconds": "other"}, {"message": "other"}, {"extras": "other"}),
        {"published_forward": 1.0},  # integers are compared as numbers
    ],
)
def test_a_row_is_the_same_as_itself_whatever_its_times_and_texts(trials, free):
    assert difference(row_of(trials[0]) | free, OUTCOME) is None


def test_a_time_limit_that_was_met_is_a_difference(trials):
    late = replace(OUTCOME, status="timeout")
    for row, outcome in ((row_of(trials[0]), late), (row_of(trials[0], late), OUTCOME)):
        assert (difference(row, outcome) or "").startswith("status is ")
    assert difference(row_of(trials[0], late), late) is None


@pytest.mark.parametrize(
    ("change", "alike"),
    [
        ({"error": 0.1 * (1 + 5e-4)}, True),
        ({"error": 0.1 * (1 + 2e-3)}, False),
        ({"error": NAN}, False),
        ({"unknown": 0.0}, False),
        ({"lost": 0.0}, False),
        ({"weights": [[0.5 + 1e-4, 0.5 - 1e-4]]}, True),
        ({"weights": [[0.5, 0.6]]}, False),
        ({"weights": [[0.5]]}, False),
        ({"weights": None}, False),
        ({"status": "crash"}, False),
        ({"published_forward": 0}, False),
    ],
)
def test_with_other_versions_last_digits_may_differ(trials, change, alike):
    row = row_of(trials[0]) | change
    assert (difference(row, OUTCOME, exact=False) is None) == alike
    assert difference(row, OUTCOME) is not None
    tiny = replace(OUTCOME, scores={"error": 1e-13})
    row = row_of(trials[0], tiny) | {"error": 9e-13}
    assert difference(row, tiny, exact=False) is None


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
