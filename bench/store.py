"""The store: one SQLite file per run folder, one committed row per trial.

The file is in WAL mode, so a run that is killed at any moment leaves every finished trial behind
and nothing half written.
"""

import json
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, fields
from pathlib import Path

import pandas as pd
from filelock import FileLock, Timeout

from bench.errors import UserError
from bench.trial import KEY_COLUMNS, Outcome, Trial

FILE_NAME = "trials.sqlite"
#: Marks the file as ours, and which layout it has.
APPLICATION_ID = 0x4F4C4E45  # "OLNE"
VERSION = 2

_LABELS = {
    "suite": "TEXT",
    "scenario": "TEXT",
    "view": "TEXT",
    "sigma": "REAL",
    "seed": "INTEGER",
    "estimator": "TEXT",
    "parameters": "TEXT",
    "count": "INTEGER",
}
_TEXT_OUTCOMES = {"status", "message", "weights"}
_OUTCOMES = {f.name: "TEXT" if f.name in _TEXT_OUTCOMES else "REAL" for f in fields(Outcome)}
COLUMNS = _LABELS | _OUTCOMES


class Store:
    """Rows of finished trials. Open it with ``open_store``."""

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._connection = connection

    def add(self, trial: Trial, outcome: Outcome) -> None:
        """Write the row of a finished trial and commit it."""
        row = trial.labels | asdict(outcome)
        if outcome.weights is not None:
            row["weights"] = json.dumps(outcome.weights)
        names = ", ".join(f'"{name}"' for name in COLUMNS)
        places = ", ".join(f":{name}" for name in COLUMNS)
        with self._connection:
            self._connection.execute(
                f"INSERT OR REPLACE INTO trials ({names}) VALUES ({places})", row
            )

    def keys(self) -> set[tuple[str, ...]]:
        """Keys of all finished trials."""
        names = ", ".join(KEY_COLUMNS)
        rows = self._connection.execute(f"SELECT {names} FROM trials")
        return {tuple(str(value) for value in row) for row in rows}

    def suites(self) -> set[str]:
        """Names of the suites that rows belong to."""
        return {row[0] for row in self._connection.execute("SELECT DISTINCT suite FROM trials")}

    def frame(self) -> pd.DataFrame:
        """All rows, in an order that does not depend on when they were written."""
        order = ", ".join(KEY_COLUMNS)
        frame = pd.read_sql_query(f"SELECT * FROM trials ORDER BY {order}", self._connection)
        frame["weights"] = [None if text is None else json.loads(text) for text in frame["weights"]]
        return frame


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
            yield Store(connection)
    finally:
        lock.release()


@contextmanager
def read_store(folder: Path) -> Iterator[Store]:
    """Open an existing run folder's store.

    Raises:
        UserError: if there is none, or it is not one of ours.
    """
    if not (folder / FILE_NAME).is_file():
        raise UserError(f"no run in {folder}: it has no {FILE_NAME}")
    with _connect(folder / FILE_NAME) as connection:
        yield Store(connection)


@contextmanager
def _connect(path: Path) -> Iterator[sqlite3.Connection]:
    try:
        connection = sqlite3.connect(path, timeout=30)
    except sqlite3.Error as error:
        raise UserError(f"cannot open {path}: {error}") from error
    try:
        _prepare(connection, path)
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


def _prepare(connection: sqlite3.Connection, path: Path) -> None:
    application = connection.execute("PRAGMA application_id").fetchone()[0]
    version = connection.execute("PRAGMA user_version").fetchone()[0]
    empty = not connection.execute("SELECT 1 FROM sqlite_master").fetchone()
    if empty and application == 0:
        columns = ", ".join(f'"{name}" {kind}' for name, kind in COLUMNS.items())
        connection.execute("PRAGMA journal_mode = WAL")
        with connection:
            connection.execute("BEGIN IMMEDIATE")
            connection.execute(
                f"CREATE TABLE trials ({columns}, PRIMARY KEY ({', '.join(KEY_COLUMNS)}))"
            )
            connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
            connection.execute(f"PRAGMA user_version = {VERSION}")
    elif application != APPLICATION_ID:
        raise sqlite3.DatabaseError("another program's database")
    elif version != VERSION:
        raise UserError(f"{path} has the layout {version}, this version reads {VERSION}")
    connection.execute("PRAGMA synchronous = NORMAL")
