"""The store of a run: finished trials, one committed row each, and their provenance."""

import sqlite3
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from functools import cache
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from olne_bench.bench.plan.outcome import NESTED, Outcome
from olne_bench.bench.plan.trial import KEY_COLUMNS, Trial
from olne_bench.bench.plan.versions import VERSION_COLUMNS, Versions
from olne_bench.bench.run.provenance import Provenance, provenance_json, read_provenance
from olne_bench.bench.run.store_file import reading, writing
from olne_bench.bench.run.store_layout import (
    COLUMNS,
    CURRENT,
    FILE_NAME,
    MOTIONS_NAME,
    NAMED,
    add_cost,
    add_metric_columns,
    costs,
    create_costs,
    metric_columns,
    quoted,
)
from olne_bench.bench.run.store_merge import merge_stores
from olne_bench.bench.run.time_left import Cost
from olne_bench.bench.text import one_line

if TYPE_CHECKING:
    # Importing them takes longer than all else that a run does before its first trial.
    import pandas as pd
    import pyarrow as pa

#: Longest message in a row [bytes].
MESSAGE_SIZE = 1024


class Record(NamedTuple):
    """The stored status of one trial with one version of the code."""

    key: tuple[str, ...]
    versions: Versions
    status: str


class Store:
    """Rows of finished trials. Open it with ``open_store`` or ``read_store``."""

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._connection = connection
        self._run = 0
        self._metrics = metric_columns(connection)

    def begin_run(self, source: Provenance, trials: Iterable[Trial]) -> None:
        """Note the provenance of the rows that follow, and the current versions.

        Args:
            source: provenance of the run.
            trials: at least one trial of each scenario, sensor and estimator of the run, whether
                it is done or not.
        """
        current = {}
        for trial in trials:
            labels = trial.labels
            place = tuple(labels[name] for name in NAMED)
            current[place] = (labels["parameters"], *_flat(trial.versions))
            self._make_columns(trial)
        create_costs(self._connection)
        places = ", ".join("?" for _ in (*NAMED, *CURRENT))
        with self._connection:
            cursor = self._connection.execute(
                "INSERT INTO runs (provenance) VALUES (?)", [provenance_json(source)]
            )
            self._run = cursor.lastrowid or 0
            self._connection.executemany(
                f"INSERT OR REPLACE INTO current VALUES ({places})",
                sorted((*place, *code) for place, code in current.items()),
            )

    def add(self, trial: Trial, outcome: Outcome) -> None:
        """Write the row of a finished trial and commit it."""
        self._make_columns(trial)
        row = asdict(outcome)
        scores, seconds = row.pop("scores"), row.pop("trial_seconds")
        row |= {name: scores.get(name) for name in self._metrics}
        row |= trial.labels | {"message": _shortened(outcome.message), "run": self._run}
        row |= zip(VERSION_COLUMNS, _flat(trial.versions), strict=True)
        row |= {name: dumps(row[name]) for name in NESTED if row[name] is not None}
        places = ", ".join(f":{name}" for name in row)
        with self._connection:
            self._connection.execute(
                f"INSERT OR REPLACE INTO trials ({quoted(row)}) VALUES ({places})", row
            )
            if seconds is not None:
                add_cost(self._connection, row["scenario"], row["estimator"], seconds)

    def _make_columns(self, trial: Trial) -> None:
        missing = [entry.column for entry in trial.metrics if entry.column not in self._metrics]
        if missing:
            with self._connection:
                add_metric_columns(self._connection, missing)
            self._metrics = metric_columns(self._connection)

    def records(self) -> Iterator[Record]:
        """All stored trials, including those of former versions of the code."""
        names = quoted((*KEY_COLUMNS, *VERSION_COLUMNS, "status"))
        width = len(KEY_COLUMNS)
        version = cache(Versions)  # a million equal objects would fill the memory, as would texts
        for row in self._connection.execute(f"SELECT {names} FROM trials"):
            key = tuple(sys.intern(str(value)) for value in row[:width])
            yield Record(key, version(*row[width:-1]), sys.intern(row[-1]))

    def costs(self) -> dict[tuple[str, str], Cost]:
        """What trials have taken so far, by scenario and estimator."""
        found = costs(self._connection)
        return {(place, name): Cost(trials, seconds) for place, name, trials, seconds in found}

    def runs(self) -> list[Provenance]:
        """Every run that has written here, the first one first."""
        rows = self._connection.execute("SELECT provenance FROM runs ORDER BY id")
        return [read_provenance(text) for (text,) in rows]

    def current_code(self) -> dict[tuple[str, ...], tuple[str, Versions]]:
        """Parameters and versions of current rows, by scenario, sensor and estimator."""
        names, width = quoted((*NAMED, *CURRENT)), len(NAMED)
        rows = self._connection.execute(f"SELECT {names} FROM current")
        return {row[:width]: (row[width], Versions(*row[width + 1 :])) for row in rows}

    def table(self) -> "pa.Table":
        """Current rows, in an order that does not depend on when they were written.

        Each metric has a column, after all others. Weights and unknowns are JSON text.
        """
        import pyarrow as pa

        from olne_bench.bench.run.store_table import schema_of

        return pa.Table.from_batches(self.batches(), schema=schema_of(self._columns))

    @property
    def _columns(self) -> dict[str, str]:
        return COLUMNS | dict.fromkeys(self._metrics, "REAL")

    def batches(self) -> "Iterator[pa.RecordBatch]":
        """``table()`` some rows at a time, so that a large store need not fit in memory."""
        from olne_bench.bench.run.store_table import as_batches

        columns = self._columns
        same = " AND ".join(f"t.{name} = c.{name}" for name in NAMED)
        current = " AND ".join(f"t.{name} = c.{name}" for name in CURRENT)
        order = quoted(KEY_COLUMNS, "t.")
        cursor = self._connection.execute(
            f"SELECT {quoted(columns, 't.')} FROM trials t LEFT JOIN current c ON {same} "
            f"WHERE c.scenario IS NULL OR ({current}) ORDER BY {order}"
        )
        yield from as_batches(cursor, columns)

    def frame(self) -> "pd.DataFrame":
        """``table()`` as a pandas table, with weights and unknowns as nested lists."""
        from olne_bench.bench.run.store_table import parse_nested, to_frame

        return to_frame(parse_nested(self.table()))

    def merge(self, other: Path) -> tuple[int, int]:
        """Add the rows and runs of another store, as ``merge_stores`` does.

        Raises:
            UserError: if the two have run different code, or parameters, under the same name.
        """
        counts = merge_stores(self._connection, other)
        self._metrics = metric_columns(self._connection)
        return counts


@contextmanager
def open_store(folder: Path, name: str = FILE_NAME) -> Iterator[Store]:
    """Open a run folder's store for writing; create folder and file if they are missing.

    Args:
        folder: the folder.
        name: name of the file; ``MOTIONS_NAME`` for a study whose samples come one by one.

    Raises:
        UserError: if the folder cannot be written, another run uses it, or its file is damaged or
            not a store.
    """
    with writing(folder, name) as connection:
        yield Store(connection)


@contextmanager
def read_store(folder: Path, name: str = FILE_NAME) -> Iterator[Store]:
    """Open an existing run folder's store; its name is as in ``open_store``.

    Raises:
        UserError: if there is none, or its file is damaged or not a store.
    """
    with reading(folder, name) as connection:
        yield Store(connection)


def store_name(folder: Path) -> str:
    """Name of the store in a folder: that of a study online if there is no other."""
    online = (folder / MOTIONS_NAME).is_file() and not (folder / FILE_NAME).is_file()
    return MOTIONS_NAME if online else FILE_NAME


def _flat(versions: Versions) -> tuple[str, ...]:
    return tuple(asdict(versions).values())


def _shortened(message: str) -> str:
    line = one_line(message)
    data = line.encode()
    if len(data) <= MESSAGE_SIZE:
        return line
    return data[: MESSAGE_SIZE - 3].decode("utf-8", "ignore") + "..."
