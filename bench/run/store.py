"""The store: one SQLite file per run folder, one committed row per trial.

The file is in WAL mode, so a run that is killed at any moment leaves every finished trial behind
and nothing half written. Rows of former versions of the code stay; tables show those of the
version that was run last, and of the parameters.
"""

import json
import os
import sqlite3
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, fields
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pandas as pd
import pyarrow as pa
from filelock import FileLock, Timeout

from olne_bench.bench.plan.trial import KEY_COLUMNS, Outcome, Trial
from olne_bench.bench.plan.versions import Versions
from olne_bench.bench.run.provenance import Provenance, read_provenance
from olne_bench.errors import UserError

FILE_NAME = "trials.sqlite"
#: Marks the file as ours, and which layout it has.
APPLICATION_ID = 0x4F4C4E45  # "OLNE"
VERSION = 3

_LABELS = {
    "suite": "TEXT",
    "scenario": "TEXT",
    "sensor": "TEXT",
    "sigma": "REAL",
    "seed": "INTEGER",
    "estimator": "TEXT",
    "parameters": "TEXT",
    "count": "INTEGER",
}
_TEXT_OUTCOMES = {"status", "message", "weights", "extras"}
_OUTCOMES = {f.name: "TEXT" if f.name in _TEXT_OUTCOMES else "REAL" for f in fields(Outcome)}
_VERSIONS = {f"{f.name}_version": "TEXT" for f in fields(Versions)}
COLUMNS = _LABELS | _OUTCOMES | _VERSIONS

#: Rows are current where what was run last under the same names had these.
_NAMED = ("scenario", "estimator")
_CURRENT = ("parameters", *_VERSIONS)
_ARROW_TYPES = {"TEXT": pa.string(), "REAL": pa.float64(), "INTEGER": pa.int64()}
_WEIGHTS = pa.list_(pa.list_(pa.float64()))
_BATCH = 50_000


class Record(NamedTuple):
    """What a store knows of one trial with one version of the code."""

    key: tuple[str, ...]
    versions: Versions
    status: str


class Store:
    """Rows of finished trials. Open it with ``open_store``."""

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._connection = connection
        self._run = 0
        names = _names(COLUMNS)
        places = ", ".join(f":{name}" for name in COLUMNS)
        self._insert = f"INSERT OR REPLACE INTO trials ({names}, run) VALUES ({places}, :run)"

    def begin_run(self, source: Provenance, trials: Iterable[Trial]) -> None:
        """Note where the rows that follow come from, and which versions are the current ones.

        Args:
            source: of the run.
            trials: all that the run is about, done or not.
        """
        current = {
            (t.scenario.label, t.estimator.label, t.labels["parameters"], *_flat(t.versions))
            for t in trials
        }
        with self._connection:
            cursor = self._connection.execute(
                "INSERT INTO runs (provenance) VALUES (?)", [json.dumps(asdict(source))]
            )
            self._run = cursor.lastrowid or 0
            self._connection.executemany(
                "INSERT OR REPLACE INTO current VALUES (?, ?, ?, ?, ?, ?)", sorted(current)
            )

    def add(self, trial: Trial, outcome: Outcome) -> None:
        """Write the row of a finished trial and commit it."""
        row = trial.labels | asdict(outcome) | {"run": self._run}
        row |= zip(_VERSIONS, _flat(trial.versions), strict=True)
        if outcome.weights is not None:
            row["weights"] = json.dumps(outcome.weights)
        with self._connection:
            self._connection.execute(self._insert, row)

    def records(self) -> Iterator[Record]:
        """Everything that is stored, former versions of the code too."""
        names = _names((*KEY_COLUMNS, *_VERSIONS, "status"))
        width = len(KEY_COLUMNS)
        version = cache(Versions)  # a million equal objects would fill the memory, as would texts
        for row in self._connection.execute(f"SELECT {names} FROM trials"):
            key = tuple(sys.intern(str(value)) for value in row[:width])
            yield Record(key, version(*row[width:-1]), sys.intern(row[-1]))

    def runs(self) -> list[Provenance]:
        """Every run that has written here, the first one first."""
        rows = self._connection.execute("SELECT provenance FROM runs ORDER BY id")
        return [read_provenance(text) for (text,) in rows]

    def table(self) -> pa.Table:
        """Current rows, in an order that does not depend on when they were written.

        The weights are JSON text.
        """
        same = " AND ".join(f"t.{name} = c.{name}" for name in _NAMED)
        current = " AND ".join(f"t.{name} = c.{name}" for name in _CURRENT)
        order = ", ".join(f"t.{name}" for name in KEY_COLUMNS)
        cursor = self._connection.execute(
            f"SELECT {_names(COLUMNS, 't.')} FROM trials t LEFT JOIN current c ON {same} "
            f"WHERE c.scenario IS NULL OR ({current}) ORDER BY {order}"
        )
        schema = pa.schema([(name, _ARROW_TYPES[kind]) for name, kind in COLUMNS.items()])
        batches = []
        while rows := cursor.fetchmany(_BATCH):
            columns = zip(*rows, strict=True)
            arrays = [pa.array(c, type=t) for c, t in zip(columns, schema.types, strict=True)]
            batches.append(pa.record_batch(arrays, schema=schema))
        return pa.Table.from_batches(batches, schema=schema)

    def frame(self) -> pd.DataFrame:
        """``table()`` for pandas, with weights as nested lists."""
        return to_frame(parse_weights(self.table()))

    def merge(self, other: Path) -> tuple[int, int]:
        """Add the rows and runs of another store, one commit for all.

        Args:
            other: the other store's file; it is only read.

        Returns:
            How many rows are new, and how many were here already and have been left as they are.

        Raises:
            UserError: if the two have run different code, or parameters, under the same name.
        """
        self._connection.execute("ATTACH DATABASE ? AS other", [str(other)])
        try:
            self._refuse_other_versions(other)
            with self._connection:
                return self._merge()
        finally:
            self._connection.execute("DETACH DATABASE other")

    def _refuse_other_versions(self, other: Path) -> None:
        match = " AND ".join(f"a.{name} = b.{name}" for name in _NAMED)
        for what in _CURRENT:
            found = self._connection.execute(
                f"SELECT a.scenario, a.estimator, a.{what}, b.{what} FROM main.current a "
                f"JOIN other.current b ON {match} WHERE a.{what} != b.{what}"
            ).fetchone()
            if found:
                scenario, estimator, here, there = found
                verb = "are" if what == "parameters" else "is"
                raise UserError(
                    f"cannot merge {other}: {what.replace('_', ' ')} of {estimator!r} on "
                    f"{scenario!r} {verb} {there or 'unknown'} there and {here or 'unknown'} here; "
                    "run one of the two again with the other's"
                )

    def _merge(self) -> tuple[int, int]:
        execute = self._connection.execute
        (offset,) = execute("SELECT coalesce(max(id), 0) FROM main.runs").fetchone()
        execute(
            "INSERT INTO main.runs (id, provenance) "
            "SELECT id + ?, provenance FROM other.runs ORDER BY id",
            [offset],
        )
        execute("INSERT OR IGNORE INTO main.current SELECT * FROM other.current")
        names = _names(COLUMNS)
        new = execute(
            f"INSERT OR IGNORE INTO main.trials ({names}, run) "
            f"SELECT {names}, run + ? FROM other.trials",
            [offset],
        ).rowcount
        (rows,) = execute("SELECT count(*) FROM other.trials").fetchone()
        return new, rows - new


def parse_weights(table: pa.Table) -> pa.Table:
    """``Store.table()`` with weights as nested lists.

    Raises:
        UserError: on weights that are none.
    """
    place = table.schema.get_field_index("weights")
    try:
        chunks = [
            # One call of the parser for a whole chunk takes a fraction of the time.
            pa.array(
                json.loads(f"[{','.join(t or 'null' for t in chunk.to_pylist())}]"), type=_WEIGHTS
            )
            for chunk in table.column(place).chunks
        ]
    except (ValueError, pa.ArrowException) as error:
        raise UserError(f"the store is damaged: weights that cannot be read ({error})") from error
    return table.set_column(place, "weights", pa.chunked_array(chunks, type=_WEIGHTS))


def to_frame(table: pa.Table) -> pd.DataFrame:
    """A table for pandas: nested lists stay in Arrow's compact form."""
    types = {_WEIGHTS: pd.ArrowDtype(_WEIGHTS)}
    return table.to_pandas(types_mapper=types.get)


def _flat(versions: Versions) -> tuple[str, ...]:
    return versions.estimator, versions.scenario, versions.scoring


def _names(columns: Iterable[str], prefix: str = "") -> str:
    return ", ".join(f'{prefix}"{name}"' for name in columns)


@contextmanager
def open_store(folder: Path) -> Iterator[Store]:
    """Open a run folder's store for writing; makes folder and file where they are missing.

    Raises:
        UserError: if the folder cannot be written, another run uses it, or the file in it is not
            a store of ours.
    """
    if folder.exists() and not folder.is_dir():
        raise UserError(f"cannot write to {folder}: it is a file, a folder is needed")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / ".lock")
        lock.acquire(timeout=0)
    except Timeout:
        raise UserError(
            f"another run is writing to {folder}; wait for it or use another --out"
        ) from None
    except OSError as error:
        raise UserError(f"cannot write to {folder}: {error.strerror or error}") from error
    try:
        with _connect(folder / FILE_NAME) as connection:
            _check(connection)
            yield Store(connection)
    finally:
        lock.release()


@contextmanager
def read_store(folder: Path, *, check: bool = False) -> Iterator[Store]:
    """Open an existing run folder's store.

    Args:
        folder: of the run.
        check: look for damage first, where not all of it is going to be read.

    Raises:
        UserError: if there is none, or it is not one of ours.
    """
    path = folder / FILE_NAME
    if folder.is_file():
        raise UserError(f"no run in {folder}: it is a file; name the run's folder")
    if not path.is_file():
        raise UserError(f"no run in {folder}: it has no {FILE_NAME}")
    if not path.stat().st_size:
        raise UserError(f"no run in {folder}: its {FILE_NAME} is empty")
    with _connect(path, read_only=True) as connection:
        former = _is_former(connection)
    if former:
        with open_store(folder):  # brings it up to date
            pass
    with _connect(path, read_only=True) as connection:
        if check:
            _check(connection)
        yield Store(connection)


@contextmanager
def _connect(path: Path, *, read_only: bool = False) -> Iterator[sqlite3.Connection]:
    try:
        connection = _reader(path) if read_only else sqlite3.connect(path, timeout=30)
    except sqlite3.Error as error:
        raise UserError(f"cannot open {path}: {error}") from error
    try:
        _refuse_foreign(connection, path)
        if not read_only:
            _prepare(connection)
        yield connection
    except sqlite3.OperationalError as error:
        raise UserError(f"cannot use {path}: {error}; nothing stored is lost") from error
    except sqlite3.DatabaseError as error:
        raise UserError(
            f"{path} is not a store of this benchmark, or is damaged ({error}); "
            "it was left as it is: move it away or use another folder"
        ) from error
    finally:
        connection.close()


def _reader(path: Path) -> sqlite3.Connection:
    """A connection that changes nothing."""
    if os.access(path.parent, os.W_OK) or path.with_name(f"{path.name}-wal").exists():
        connection = sqlite3.connect(path, timeout=30)
        connection.execute("PRAGMA query_only = 1")
        return connection
    # SQLite would keep notes beside the file.
    return sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", timeout=30, uri=True)


def _check(connection: sqlite3.Connection) -> None:
    """Find damage before anything is added to it."""
    (result,) = connection.execute("PRAGMA quick_check(1)").fetchone()
    if result != "ok":
        raise sqlite3.DatabaseError(" ".join(result.split()))


def _refuse_foreign(connection: sqlite3.Connection, path: Path) -> None:
    application = connection.execute("PRAGMA application_id").fetchone()[0]
    version = connection.execute("PRAGMA user_version").fetchone()[0]
    if not _is_empty(connection) and application != APPLICATION_ID:
        raise sqlite3.DatabaseError("another program's database")
    if version > VERSION:
        raise UserError(
            f"{path} was written by a newer version of olne-bench: it has the layout {version}, "
            f"this one knows {VERSION}; update olne-bench, or use another folder"
        )


def _is_empty(connection: sqlite3.Connection) -> bool:
    return not connection.execute("SELECT 1 FROM sqlite_master").fetchone()


def _is_former(connection: sqlite3.Connection) -> bool:
    """Whether the file lacks anything that this version's files have."""
    version = connection.execute("PRAGMA user_version").fetchone()[0]
    return version < VERSION or bool(_missing_columns(connection))


def _prepare(connection: sqlite3.Connection) -> None:
    """Create what is not there, and bring a former layout up to date."""
    if _is_empty(connection):
        connection.execute("PRAGMA journal_mode = WAL")
        with connection:
            connection.execute("BEGIN IMMEDIATE")
            _create(connection)
            connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
    version = connection.execute("PRAGMA user_version").fetchone()[0]
    with connection:
        connection.execute("BEGIN IMMEDIATE")
        if version == 1:
            _upgrade_1(connection)
        elif version == 2:
            _upgrade_2(connection)
        for name in _missing_columns(connection):  # of older rows they are not known
            connection.execute(f'ALTER TABLE trials ADD COLUMN "{name}" {_OUTCOMES[name]}')
    connection.execute("PRAGMA synchronous = NORMAL")


def _create(connection: sqlite3.Connection) -> None:
    columns = ", ".join(f'"{name}" {kind}' for name, kind in COLUMNS.items())
    key = _names((*KEY_COLUMNS, *_VERSIONS))
    connection.execute(f"CREATE TABLE trials ({columns}, run INTEGER, PRIMARY KEY ({key}))")
    connection.execute("CREATE TABLE runs (id INTEGER PRIMARY KEY, provenance TEXT)")
    _create_current(connection)


def _create_current(connection: sqlite3.Connection) -> None:
    columns = _names((*_NAMED, *_CURRENT))
    connection.execute(
        f"CREATE TABLE current ({columns}, PRIMARY KEY ({_names(_NAMED)})) WITHOUT ROWID"
    )
    connection.execute(f"PRAGMA user_version = {VERSION}")


def _upgrade_1(connection: sqlite3.Connection) -> None:
    """Layout 1 knew no versions: its rows stay, and count as those of an unknown one."""
    connection.execute("ALTER TABLE trials RENAME TO former")
    _create(connection)
    known = {row[1] for row in connection.execute("PRAGMA table_info(former)")}
    names = _names(name for name in COLUMNS if name in known)
    unknown = ", ".join("''" for _ in _VERSIONS)
    connection.execute(
        f"INSERT INTO trials ({names}, {_names(_VERSIONS)}, run) "
        f"SELECT {names}, {unknown}, 0 FROM former"
    )
    connection.execute(
        f"INSERT OR REPLACE INTO current SELECT {_names((*_NAMED, 'parameters'))}, {unknown} "
        "FROM former ORDER BY rowid"
    )
    connection.execute("DROP TABLE former")


def _upgrade_2(connection: sqlite3.Connection) -> None:
    """Layout 2 took several parameters under one name for current; those of the last run are."""
    connection.execute("ALTER TABLE current RENAME TO former")
    _create_current(connection)
    names = (*_NAMED, *_CURRENT)
    same = " AND ".join(f"t.{name} = f.{name}" for name in names)
    connection.execute(
        f"INSERT OR REPLACE INTO current SELECT {_names(names, 'f.')} FROM former f "
        f"ORDER BY (SELECT max(run) FROM trials t WHERE {same})"
    )
    connection.execute("DROP TABLE former")


def _missing_columns(connection: sqlite3.Connection) -> list[str]:
    known = {row[1] for row in connection.execute("PRAGMA table_info(trials)")}
    return [name for name in _OUTCOMES if name not in known]
