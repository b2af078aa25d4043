"""The file of a store: find it, lock it, check it for damage and connect to it.

The file is in WAL mode, so a run that is killed at any moment leaves all finished trials and no
half-written one.
"""

import os
import sqlite3
import struct
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from olne_bench.bench.run.store_check import checksum, is_undecodable, refuse_damaged, said
from olne_bench.bench.run.store_layout import (
    APPLICATION_ID,
    FILE_NAME,
    VERSION,
    create,
)
from olne_bench.errors import UserError
from olne_bench.files import check_folder

_HEADER = 100  # bytes; sqlite.org/fileformat.html


@contextmanager
def writing(folder: Path) -> Iterator[sqlite3.Connection]:
    """A connection for writing to a run folder's store, which locks out other writers.

    Folder and file are created if they are missing.

    Raises:
        UserError: if the folder cannot be written or has files of others, another run uses it, or
            its file is damaged or not a store.
    """
    try:
        check_folder(folder, (FILE_NAME,), (".lock", "workers.log"))
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
        with _connected(folder / FILE_NAME, _writer) as connection:
            yield connection
    finally:
        lock.release()


@contextmanager
def reading(folder: Path) -> Iterator[sqlite3.Connection]:
    """A read-only connection to an existing run folder's store.

    Raises:
        UserError: if there is none, or its file is damaged or not a store.
    """
    path = folder / FILE_NAME
    try:
        if folder.is_file():
            raise UserError(f"no run in {folder}: it is a file; name the run's folder")
        if not path.is_file():
            raise UserError(f"no run in {folder}: it has no {FILE_NAME}")
        if not path.stat().st_size:
            raise UserError(f"no run in {folder}: its {FILE_NAME} is empty")
    except OSError as error:
        raise UserError(f"cannot read {folder}: {error.strerror or error}") from error
    with _connected(path, _reader) as connection:
        yield connection


@contextmanager
def glancing(folder: Path) -> Iterator[sqlite3.Connection]:
    """A read-only connection to a store that was read before: it is not checked again.

    Raises:
        sqlite3.Error: if it cannot be read any more.
    """
    with closing(_reader(folder / FILE_NAME)) as connection:
        connection.create_function("checksum", -1, checksum)
        yield connection


def _reader(path: Path) -> sqlite3.Connection:
    if os.access(path.parent, os.W_OK) or path.with_name(f"{path.name}-wal").exists():
        connection = _writer(path)
        connection.execute("PRAGMA query_only = 1")
        return connection
    # SQLite would write files beside it.
    return sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", timeout=30, uri=True)


def _writer(path: Path) -> sqlite3.Connection:
    return sqlite3.connect(path, timeout=30)


@contextmanager
def _connected(
    path: Path, connect: Callable[[Path], sqlite3.Connection]
) -> Iterator[sqlite3.Connection]:
    try:
        _refuse_truncated(path)
        connection = connect(path)
    except (sqlite3.Error, OSError) as error:
        raise UserError(f"cannot open {path}: {said(error)}") from error
    try:
        _begin(connection, path, connect is _writer)
        yield connection
    except sqlite3.OperationalError as error:
        if is_undecodable(error):
            raise _damaged(path, error) from error
        raise UserError(f"cannot use {path}: {said(error)}; nothing stored is lost") from error
    except sqlite3.DatabaseError as error:
        raise _damaged(path, error) from error
    finally:
        connection.close()


def _begin(connection: sqlite3.Connection, path: Path, writes: bool) -> None:
    """Refuse what is no store, or is damaged, before anything is read or added."""
    connection.create_function("checksum", -1, checksum)
    try:
        if writes:
            _prepare(connection, path)
        _refuse_foreign(connection, path)
        refuse_damaged(connection)
    except UnicodeDecodeError as error:  # of what SQLite says
        raise _damaged(path, "a name in it is no text in UTF-8") from error


def _damaged(path: Path, cause: object) -> UserError:
    return UserError(
        f"{path} is not a store of this benchmark, or is damaged ({said(cause)}); "
        "it was left as it is: move it away or use another folder"
    )


def _refuse_truncated(path: Path) -> None:
    """Refuse a file that has lost its end, which SQLite does not notice."""
    if not path.exists() or not path.stat().st_size:
        return
    with path.open("rb") as file:
        header = file.read(_HEADER)
    if not header.startswith(b"SQLite format 3\0"):
        raise _damaged(path, "file is not a database")
    log = path.with_name(f"{path.name}-wal")
    if log.exists() and log.stat().st_size:
        return  # a run was killed or is running: pages may be in the log only
    (size,) = struct.unpack(">H", header[16:18])
    (pages,) = struct.unpack(">I", header[28:32])
    whole = pages * (65536 if size == 1 else size)
    if path.stat().st_size != whole:
        raise _damaged(path, f"it has {path.stat().st_size} bytes instead of {whole}")


def _refuse_foreign(connection: sqlite3.Connection, path: Path) -> None:
    application = connection.execute("PRAGMA application_id").fetchone()[0]
    version = connection.execute("PRAGMA user_version").fetchone()[0]
    if application != APPLICATION_ID:
        raise sqlite3.DatabaseError("another program's database")
    if version != VERSION:
        what = "a newer version" if version > VERSION else "an unreleased version"
        raise UserError(
            f"{path} was written by {what} of olne-bench: it has the layout {version}, "
            f"this one knows {VERSION}; use that version, or another folder"
        )


def _prepare(connection: sqlite3.Connection, path: Path) -> None:
    """Create the tables if they are missing."""
    if not connection.execute("SELECT 1 FROM sqlite_master").fetchone():
        connection.execute("PRAGMA journal_mode = WAL")
        with connection:
            connection.execute("BEGIN IMMEDIATE")
            create(connection)
    else:
        _refuse_foreign(connection, path)  # before anything is changed
    connection.execute("PRAGMA synchronous = NORMAL")
