"""Rows of a submission: read them, check them, and compare them with trials that are run again."""

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
from pyarrow import parquet

from olne_bench.bench.plan.outcome import OUTCOME_COLUMNS, Outcome
from olne_bench.bench.plan.trial import KEY_COLUMNS, LABEL_COLUMNS, Trial
from olne_bench.bench.plan.versions import VERSION_COLUMNS, environment
from olne_bench.bench.report.submission.manifest import ROWS, Submission
from olne_bench.bench.run.store_table import to_frame
from olne_bench.errors import UserError

Row = Mapping[str, Any]

#: Columns that may differ between machines and runs, and enter no table.
_FREE = {"solve_seconds", "trial_seconds", "message", "extras"}
_TIMEOUT = "timeout"


@dataclass(frozen=True)
class Rows:
    """The rows of a submission.

    Attributes:
        table: the rows, as ``Store.frame`` returns them.
        by_key: the rows by ``Trial.key``.
    """

    table: pd.DataFrame
    by_key: Mapping[tuple[str, ...], Row]


def read_rows(submission: Submission) -> Rows:
    """The rows of a submission.

    Raises:
        UserError: if the file does not hold rows, or has two rows of one trial.
    """
    place = submission.folder / ROWS
    try:
        table = parquet.read_table(place)
    except (OSError, pa.ArrowException) as error:
        raise UserError(f"{place} cannot be read: {' '.join(str(error).split())}") from error
    needed = [*LABEL_COLUMNS, *OUTCOME_COLUMNS, *VERSION_COLUMNS]
    lacking = [name for name in needed if name not in table.column_names]
    if lacking:
        raise UserError(f"{place} has no column {lacking[0]!r}")
    rows = table.to_pylist()
    by_key = {_key(row): row for row in rows}
    if len(by_key) < len(rows):
        raise UserError(f"{place} has {len(rows) - len(by_key)} trials more than once")
    return Rows(to_frame(table), by_key)


def _key(row: Row) -> tuple[str, ...]:
    return tuple(str(row[name]) for name in KEY_COLUMNS)


def check_whole(rows: Rows, planned: Mapping[tuple[str, ...], Trial], place: Path) -> None:
    """Refuse rows that are not exactly those that the runs were asked for.

    Raises:
        UserError: if a row is missing, or one is too many.
    """
    for what, keys in (
        ("lacks the row of", planned.keys() - rows.by_key.keys()),
        ("has a row that its suite does not ask for:", rows.by_key.keys() - planned.keys()),
    ):
        if keys:
            raise UserError(
                f"{place} {what} {described(dict(zip(KEY_COLUMNS, min(keys), strict=True)))} "
                f"({len(keys)} such in all)"
            )


def described(row: Row) -> str:
    """A trial as text."""
    place = ", ".join(str(row[name]) for name in ("estimator", "scenario", "sensor"))
    return f"{place}, sigma {row['sigma']}, seed {row['seed']}"


def other_versions(row: Row, trial: Trial) -> list[str]:
    """Which versions of a row differ from those of the present code."""
    return [name for name, here in asdict(trial.versions).items() if row[f"{name}_version"] != here]


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
            f"{name} {there.get(name, '?')} there, {here.get(name, '?')} here"
            for name in sorted({*there, *here})
            if there.get(name) != here.get(name)
        ]
        said.append("; ".join(pairs) or "the environment")
    return "; ".join(said)


def difference(row: Row, outcome: Outcome) -> str | None:
    """The first difference between a row and its trial run again, as text; None if there is none.

    Status, weights and every number that a table uses are compared, bit by bit; times, messages
    and extras are not. A trial that reached its time limit, here or there, depends on the machine
    and is not compared.
    """
    if timed_out(row, outcome):
        return None
    again = asdict(outcome)
    scores = again.pop("scores")
    for name, here in (again | scores).items():
        there = row.get(name)
        if name not in _FREE and not _same(there, here):
            return f"{name} is {_shown(there)} in the submission and {_shown(here)} here"
    return None


def timed_out(row: Row, outcome: Outcome) -> bool:
    """Whether ``difference`` compares nothing."""
    return _TIMEOUT in (row["status"], outcome.status)


def _same(there: Any, here: Any) -> bool:
    if isinstance(there, float) and isinstance(here, int | float):
        return there == here or (math.isnan(there) and math.isnan(here))
    return bool(there == here)


def _shown(value: Any) -> str:
    text = json.dumps(value) if isinstance(value, list) else str(value)
    return text if len(text) <= 120 else f"{text[:117]}..."
