"""Rows of a submission: read them, check them, and compare them with trials that are run again."""

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from olne_bench.bench.plan.outcome import NESTED, STATUSES, Outcome
from olne_bench.bench.plan.trial import KEY_COLUMNS, Trial
from olne_bench.bench.plan.versions import VERSION_COLUMNS, environment, environment_version
from olne_bench.bench.run.store_table import to_frame
from olne_bench.bench.submission.files import read_file
from olne_bench.bench.submission.manifest import ROWS, Submission
from olne_bench.bench.submission.parquet_rows import read_parquet
from olne_bench.errors import UserError

Row = Mapping[str, Any]
Key = tuple[str, ...]

#: Columns that may differ between machines and runs, and enter no table but that of times.
_FREE = {"solve_seconds", "trial_seconds", "message", "extras", "scene", "motion"}
#: With other versions of code or libraries, numbers may differ by so much: relatively, or by less
#: than is worth a comparison.
OTHER_RELATIVE, OTHER_ABSOLUTE = 1e-3, 1e-7
_KINDS = [name.removesuffix("_version") for name in VERSION_COLUMNS]


@dataclass(frozen=True)
class Rows:
    """The rows of a submission."""

    table: pd.DataFrame  # as ``Store.frame`` returns it
    arrow: pa.Table  # the same, as it was read
    places: Mapping[Key, int]  # number of each row, by ``Trial.key``

    def row(self, key: Key) -> Row:
        """The row of a trial."""
        found: Row = self.arrow.slice(self.places[key], 1).to_pylist()[0]
        return found


def read_rows(submission: Submission) -> Rows:
    """The rows of a submission; UserError if a value is impossible, or a trial has two rows."""
    place = submission.folder / ROWS
    table = read_parquet(read_file(submission.folder, ROWS), place)
    _check_values(table, place)
    columns = (table.column(name).to_pylist() for name in KEY_COLUMNS)
    places = {tuple(map(str, key)): k for k, key in enumerate(zip(*columns, strict=True))}
    if len(places) < table.num_rows:
        raise UserError(f"{place} has {table.num_rows - len(places)} trials more than once")
    if not places:
        raise UserError(f"{place} has no row")
    return Rows(to_frame(table), table, places)


def _check_values(table: pa.Table, place: Path) -> None:
    for name in (*KEY_COLUMNS, "suite", "count", "status", *VERSION_COLUMNS):
        if table.column(name).null_count:
            raise UserError(f"{place} has a row without {name}")
    strange = set(pc.unique(table.column("status")).to_pylist()) - {*STATUSES}
    if strange:
        raise UserError(
            f"{place} has the status {min(strange)[:40]!r}; known: {', '.join(STATUSES)}"
        )
    if "harness_error" in pc.unique(table.column("status")).to_pylist():
        raise UserError(f"{place} has trials that could not be judged: status 'harness_error'")
    for field in table.schema:
        column = table.column(field.name)
        if pa.types.is_floating(field.type) and pc.any(pc.is_inf(column)).as_py():
            raise UserError(f"{place} has an infinite {field.name}")
    shortest = pc.min_max(table.column("solve_seconds"))["min"].as_py()
    if shortest is not None and shortest < 0:
        raise UserError(f"{place} has a negative time, {shortest:g} s")
    for name in NESTED:
        chunks = pc.drop_null(table.column(name)).chunks
        if any(_is_ragged(value) for chunk in chunks for value in chunk.to_pylist()):
            raise UserError(f"{place} has {name} that are not a table of finite numbers")


def _is_ragged(value: list[list[float | None] | None]) -> bool:
    if not value or any(not row or len(row) != len(value[0] or ()) for row in value):
        return True
    return not all(n is not None and math.isfinite(n) for row in value for n in row or ())


def check_whole(rows: Rows, planned: Mapping[Key, Trial], place: Path) -> None:
    """Refuse rows that are not exactly those that the runs were asked for (UserError)."""
    for what, keys in (
        ("lacks the row of", planned.keys() - rows.places.keys()),
        ("has a row that its suite does not ask for:", rows.places.keys() - planned.keys()),
    ):
        if keys:
            raise UserError(
                f"{place} {what} {described(dict(zip(KEY_COLUMNS, min(keys), strict=True)))} "
                f"({len(keys)} such in all)"
            )
    suites, counts = (rows.arrow.column(name).to_pylist() for name in ("suite", "count"))
    for key, trial in planned.items():
        k = rows.places[key]
        for name, there, here in (
            ("suite", suites[k], trial.suite),
            ("count", counts[k], trial.count),
        ):
            if there != here:
                raise UserError(
                    f"{place}: {name} is {_shown(there)} and not {_shown(here)} in the row of "
                    f"{described(trial.labels)}"
                )


def check_versions(rows: Rows, planned: Mapping[Key, Trial], submission: Submission) -> set[str]:
    """Kinds of versions that differ from those here, for all rows alike.

    The versions of libraries are those that the manifest lists. What has one fingerprint here had
    one there: rows of one estimator, scenario, sensor or metrics are of one code.
    """
    listed = {environment_version(run.environment) for run in submission.runs}
    pairs: dict[tuple[str, str], str] = {}
    columns = {kind: rows.arrow.column(f"{kind}_version").to_pylist() for kind in _KINDS}
    for key, trial in planned.items():
        for kind, here in asdict(trial.versions).items():
            there = columns[kind][rows.places[key]]
            known = there in listed if kind == "environment" else True
            if not known or pairs.setdefault((kind, here), there) != there:
                raise UserError(
                    f"{submission.folder}: {kind}_version of {described(trial.labels)} is "
                    f"{_shown(there)}, which does not follow from the manifest and the other rows"
                )
    return {kind for (kind, here), there in pairs.items() if here != there}


def described(row: Row) -> str:
    """A trial as text."""
    place = ", ".join(str(row[name]) for name in ("estimator", "scenario", "sensor"))
    return f"{place}, sigma {row['sigma']}, seed {row['seed']}"


def explain_versions(kinds: Iterable[str], submission: Submission) -> str:
    """A text on what differs, for each kind of version (``Versions``)."""
    said = []
    there = submission.runs[-1].environment
    for kind in sorted(set(kinds)):
        if kind != "environment":
            said.append(f"the code of the {kind}")
            continue
        here = environment()
        pairs = [
            f"{_shown(name)} {_shown(there.get(name, '?'))} there, {here.get(name, '?')} here"
            for name in sorted({*there, *here})
            if there.get(name) != here.get(name)
        ]
        said.append("; ".join(pairs) or "the environment")
    return "; ".join(said)


def difference(row: Row, outcome: Outcome, *, exact: bool = True) -> str | None:
    """The first difference between a row and its trial run again, as text; None if there is none.

    Status, weights and every number that a table uses are compared; times, messages and extras are
    not. If not ``exact``, numbers may differ as ``OTHER_RELATIVE`` and ``OTHER_ABSOLUTE`` say.
    """
    again = asdict(outcome)
    scores = again.pop("scores")
    same = _same if exact else _alike
    for name, here in (again | scores).items():
        there = row.get(name)
        if name not in _FREE and not same(there, here):
            return f"{name} is {_shown(there)} in the submission and {_shown(here)} here"
    return None


def _same(there: Any, here: Any) -> bool:
    if isinstance(there, float) and isinstance(here, int | float):
        return there == here or (math.isnan(there) and math.isnan(here))
    return bool(there == here)


def _alike(there: Any, here: Any) -> bool:
    if isinstance(there, list) and isinstance(here, list):
        return len(there) == len(here) and all(map(_alike, there, here))
    if isinstance(there, int | float) and isinstance(here, int | float):
        near = math.isclose(there, here, rel_tol=OTHER_RELATIVE, abs_tol=OTHER_ABSOLUTE)
        return near or _same(there, here)
    return _same(there, here)


def _shown(value: Any) -> str:
    text = json.dumps(value) if isinstance(value, list) else str(value)
    return text if len(text) <= 120 else f"{text[:117]}..."
