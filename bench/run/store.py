"""The store of a run: finished trials, one committed row each, and their provenance."""

import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from json import dumps
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from olne_bench.bench.plan.outcome import NESTED, STATUSES, Outcome
from olne_bench.bench.plan.trial import (
    CELL_COLUMNS,
    CODE_COLUMNS,
    KEY_COLUMNS,
    Trial,
)
from olne_bench.bench.plan.versions import VERSION_COLUMNS, Versions
from olne_bench.bench.run.provenance import Provenance, provenance_json, read_provenance
from olne_bench.bench.run.store_check import (
    FILLED,
    Checksums,
    as_stored,
    checksum,
    damage,
    is_undecodable,
)
from olne_bench.bench.run.store_file import reading, writing
from olne_bench.bench.run.store_layout import (
    COLUMNS,
    CURRENT,
    NAMED,
    add_cost,
    add_metric_columns,
    costs,
    metric_columns,
    quoted,
)
from olne_bench.bench.run.store_merge import merge_stores
from olne_bench.bench.run.store_scenes import add_scenes
from olne_bench.bench.run.time_left import Cost
from olne_bench.bench.text import one_line

if TYPE_CHECKING:
    # Importing them takes longer than all else that a run does before its first trial.
    import pandas as pd
    import pyarrow as pa

#: Longest message in a row [bytes].
MESSAGE_SIZE = 1024
#: Number of rows that are read at a time.
_BATCH = 50_000


#: The status of trials by seed, for each ``(*Trial.cell, *Trial.code)``.
Records = dict[tuple[Any, ...], dict[int, str]]
_STATUS = [*COLUMNS].index("status")
_filled = itemgetter(*(k for k, name in enumerate(COLUMNS) if name in FILLED))
_STATUSES = {status: status for status in STATUSES}  # a million equal texts would fill the memory


class Store:
    """Rows of finished trials. Open it with ``open_store`` or ``read_store``."""

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._connection = connection
        self._run = 0
        self._learn_metrics()

    def _learn_metrics(self) -> None:
        self._metrics = metric_columns(self._connection)
        self._sums = Checksums(self._metrics)
        self._columns = COLUMNS | dict.fromkeys(self._metrics, "REAL")
        names = quoted((*self._columns, "run", "checksum"))
        places = ", ".join("?" * (len(self._columns) + 2))
        self._insert = f"INSERT OR REPLACE INTO trials ({names}) VALUES ({places})"

    def begin_run(self, source: Provenance, trials: Iterable[Trial]) -> None:
        """Note the provenance of the rows that follow, and the current versions."""
        current = {}
        for trial in trials:
            labels = trial.labels
            place = tuple(labels[name] for name in NAMED)
            current[place] = (labels["parameters"], *_flat(trial.versions))
            self._make_columns(trial)
        rows = sorted((*place, *code) for place, code in current.items())
        places = ", ".join("?" for _ in (*NAMED, *CURRENT, "checksum"))
        with self._connection:
            cursor = self._connection.execute(
                "INSERT INTO runs (provenance, checksum) VALUES (:told, checksum(:told))",
                {"told": provenance_json(source)},
            )
            self._run = cursor.lastrowid or 0
            self._connection.executemany(
                f"INSERT OR REPLACE INTO current VALUES ({places})",
                [(*row, checksum(*row)) for row in rows],
            )

    def add(self, trial: Trial, outcome: Outcome) -> None:
        """Write the row of a finished trial, its truth and its motion, and commit them."""
        self._make_columns(trial)
        row = outcome.columns | {name: outcome.scores.get(name) for name in self._metrics}
        row |= trial.labels | {"message": _shortened(outcome.message)}
        row |= zip(VERSION_COLUMNS, _flat(trial.versions), strict=True)
        row |= {name: dumps(row[name]) for name in NESTED if row[name] is not None}
        values = tuple(as_stored(row[name], kind) for name, kind in self._columns.items())
        with self._connection:
            self._connection.execute(self._insert, (*values, self._run, self._sums.of(values)))
            add_scenes(self._connection, trial, outcome)
            if (seconds := outcome.trial_seconds) is not None:
                add_cost(self._connection, row["scenario"], row["estimator"], seconds)

    def _make_columns(self, trial: Trial) -> None:
        missing = [entry.column for entry in trial.metrics if entry.column not in self._metrics]
        if missing:
            with self._connection:
                add_metric_columns(self._connection, missing)
            self._learn_metrics()

    def records(self) -> Records:
        """The status of all stored trials, including those of former versions of the code.

        Raises:
            UserError: on a row without a seed or with an unknown status; names it.
        """
        names = quoted((*CELL_COLUMNS, *CODE_COLUMNS, "seed", "status"))
        found: Records = {}
        with self._intact_rows():
            # A tight loop, as there may be millions.
            for row in self._connection.execute(f"SELECT {names} FROM trials NOT INDEXED"):
                group = found.get(row[:-2])
                if group is None:
                    group = found[row[:-2]] = {}
                group[row[-2]] = _STATUSES.get(row[-1], "")
        for group in found.values():
            if "" in group.values() or set(map(type, group)) != {int}:
                raise damage(self._connection)
        return found

    def check(self) -> None:
        """Compare all rows with their checksums.

        Raises:
            UserError: on the first row that is damaged; names it.
        """
        for _ in self._checked("SELECT {columns} FROM trials t NOT INDEXED"):
            pass

    def _checked(self, query: str) -> Iterator[list[tuple[Any, ...]]]:
        """Rows of a query for all columns, then the checksum, some at a time."""
        names = quoted((*self._columns, "checksum"), "t.")
        with self._intact_rows():
            cursor = self._connection.execute(query.format(columns=names))
            while batch := cursor.fetchmany(_BATCH):
                if not all(self._is_whole(row) for row in batch):
                    raise damage(self._connection)
                yield batch

    def _is_whole(self, row: tuple[Any, ...]) -> bool:
        return (
            self._sums.of(row) == row[-1] and row[_STATUS] in _STATUSES and None not in _filled(row)
        )

    @contextmanager
    def _intact_rows(self) -> Iterator[None]:
        """Where a text is not UTF-8, say which."""
        try:
            yield
        except sqlite3.OperationalError as error:
            if is_undecodable(error):
                raise damage(self._connection) from error
            raise

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

    def batches(self) -> "Iterator[pa.RecordBatch]":
        """``table()`` some rows at a time, so that a large store need not fit in memory.

        Raises:
            UserError: on a damaged row; names it.
        """
        from olne_bench.bench.run.store_table import BAD_VALUES, as_batch

        same = " AND ".join(f"t.{name} = c.{name}" for name in NAMED)
        current = " AND ".join(f"t.{name} = c.{name}" for name in CURRENT)
        order = quoted(KEY_COLUMNS, "t.")
        for rows in self._checked(
            f"SELECT {{columns}} FROM trials t LEFT JOIN current c ON {same} "
            f"WHERE c.scenario IS NULL OR ({current}) ORDER BY {order}"
        ):
            try:
                batch = as_batch(rows, self._columns)
            except BAD_VALUES as error:
                raise damage(self._connection) from error
            yield batch

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
        self._learn_metrics()
        return counts


@contextmanager
def open_store(folder: Path) -> Iterator[Store]:
    """Open a run folder's store for writing; create folder and file if they are missing.

    Raises:
        UserError: if the folder cannot be written, another run uses it, or its file is damaged or
            not a store.
    """
    with writing(folder) as connection:
        yield Store(connection)


@contextmanager
def read_store(folder: Path) -> Iterator[Store]:
    """Open an existing run folder's store.

    Raises:
        UserError: if there is none, or its file is damaged or not a store.
    """
    with reading(folder) as connection:
        yield Store(connection)


def _flat(versions: Versions) -> tuple[str, ...]:
    return tuple(vars(versions).values())


def _shortened(message: str) -> str:
    line = one_line(message)
    data = line.encode()
    if len(data) <= MESSAGE_SIZE:
        return line
    return data[: MESSAGE_SIZE - 3].decode("utf-8", "ignore") + "..."
