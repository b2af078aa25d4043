"""The rows of a study of drives, in a CSV file.

A row is written as soon as its drive is over. What was interrupted goes on: drives that have a row
of the same code are not run again, unless it tells of a fault of the harness.
"""

import csv
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import msgspec
import pandas as pd

from olne_bench.bench.judge.driving import ERROR_COLUMNS, DriveRow
from olne_bench.bench.plan.drive import DriveTask
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.salt import salt_id
from olne_bench.bench.text import csv_text, one_line

Row = dict[str, Any]

#: What identifies a drive, and its planner; and the code that made a row.
KEY = ("road", "traffic", "weights", "sigma", "seed", "salt_id", "planner")
CODE = "code"
COLUMNS = (
    *KEY,
    CODE,
    *(one.name for one in fields(DriveRow) if one.name != "errors"),
    *ERROR_COLUMNS,
)
_NAMED = (*KEY, CODE)
_FAULT = "harness_error"


def row_of(task: DriveTask, outcome: Outcome) -> Row:
    """The row of a drive."""
    known = {} if outcome.extras is None else msgspec.json.decode(outcome.extras)
    row = {"status": outcome.status, "message": outcome.message} | known
    errors = row.pop("errors", {})
    return _named(task) | row | errors


def _named(task: DriveTask) -> Row:
    rules = task.rules
    values = (task.road, task.traffic, task.weights, rules.sigma, task.seed)
    return dict(zip(_NAMED, (*values, salt_id(task.salt), task.planner, task.code), strict=True))


class DriveFile:
    """The rows of a study, in a CSV file that grows by whole lines."""

    def __init__(self, path: Path) -> None:
        """Open a file that is there, or begin one. A line that was cut off is removed."""
        self._path = path
        if not path.exists():
            with path.open("w", encoding="utf-8", newline="") as file:
                csv.DictWriter(file, COLUMNS).writeheader()
            return
        text = path.read_bytes()
        whole = text[: text.rfind(b"\n") + 1]
        if len(whole) < len(text):
            path.write_bytes(whole)

    def read(self, codes: Mapping[str, str] | None = None) -> pd.DataFrame:
        """All rows; where a drive has several, the last one.

        Args:
            codes: code of a planner, by its label; only rows of this code then.
        """
        rows = pd.read_csv(self._path, dtype={"salt_id": str, "message": str, CODE: str})
        rows = rows.drop_duplicates(list(KEY), keep="last", ignore_index=True)
        if codes is not None:
            rows = rows[rows[CODE] == rows["planner"].map(codes)].reset_index(drop=True)
        return rows

    def done(self) -> set[tuple[str, ...]]:
        """Keys and codes of drives that need not be run again."""
        rows = self.read()
        kept = rows.loc[rows["status"] != _FAULT, list(_NAMED)].to_numpy()
        return {_as_text(dict(zip(_NAMED, key, strict=True))) for key in kept}

    def add(self, row: Row) -> None:
        """Write a row."""
        with self._path.open("a", encoding="utf-8", newline="") as file:
            written = row | {"message": csv_text(one_line(row.get("message", "")))}
            csv.DictWriter(file, COLUMNS).writerow(written)


def is_done(task: DriveTask, done: set[tuple[str, ...]]) -> bool:
    """Whether a drive is among those of ``DriveFile.done``."""
    return _as_text(_named(task)) in done


def _as_text(key: Row) -> tuple[str, ...]:
    numbers = ("sigma", "seed")
    return tuple(f"{float(key[name]):g}" if name in numbers else str(key[name]) for name in _NAMED)
