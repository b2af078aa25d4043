"""Checks of a store: its tables, a checksum in each row, and what is wrong with a damaged row.

SQLite notices a page that cannot be one, and a key that differs from that in its index. It does not
notice another byte in a value. So each row has the CRC-32 of its values, which differs for sure
where up to 32 adjacent bits have changed.
"""

import json
import math
import sqlite3
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from olne_bench.bench.plan.outcome import NESTED, STATUSES
from olne_bench.bench.plan.trial import LABEL_COLUMNS
from olne_bench.bench.plan.values import cut, shown
from olne_bench.bench.plan.versions import VERSION_COLUMNS
from olne_bench.bench.run.store_layout import COLUMNS, SMALL_TABLES, TABLES, metric_columns, quoted
from olne_bench.errors import UserError

#: Columns that have a value in every row.
FILLED = (*LABEL_COLUMNS, "status", "message", *VERSION_COLUMNS)
_WIDTH = len(COLUMNS)
_TYPES = {"TEXT": str, "REAL": float, "INTEGER": int}
_CALLED = {"TEXT": "a text", "REAL": "a number", "INTEGER": "a whole number"}
_encode = msgspec.msgpack.Encoder().encode


def checksum(*values: object) -> int:
    """CRC-32 of values, as SQLite has them; also an SQL function of each connection to a store."""
    return zlib.crc32(_encode(values))


class Checksums:
    """Checksums of rows. Metrics without a value do not count, so that columns may be added."""

    def __init__(self, metrics: Sequence[str]) -> None:
        """For a store with these metrics."""
        self._metrics = metrics
        self._starts: dict[tuple[bool, ...], int] = {}

    def of(self, row: Sequence[Any]) -> int:
        """The checksum of a row.

        Args:
            row: values of ``COLUMNS`` and of the metrics, and maybe more.
        """
        scores = row[_WIDTH : _WIDTH + len(self._metrics)]
        there = tuple([value is not None for value in scores])
        start = self._starts.get(there)
        if start is None:
            names = [name for name, known in zip(self._metrics, there, strict=True) if known]
            start = self._starts[there] = checksum(*names)
        known = [value for value in scores if value is not None]
        return zlib.crc32(_encode((row[:_WIDTH], known)), start)


def as_stored(value: Any, kind: str) -> Any:
    """A value as SQLite gives it back from a column of a type."""
    if value is None or kind == "TEXT":
        return value
    if kind == "INTEGER":
        return int(value)
    number = float(value) + 0.0  # no negative zero
    return None if math.isnan(number) else number


def refuse_damaged(connection: sqlite3.Connection) -> None:
    """Refuse a file whose structure is damaged, or in which another table than trials is.

    Raises:
        sqlite3.DatabaseError: says in one line what is wrong.
    """
    for table, columns in TABLES.items():
        found = [tuple(row[1:3]) for row in connection.execute(f"PRAGMA table_info({table})")]
        if table == "trials":
            named = connection.execute("SELECT name FROM metrics")
            columns = columns | dict.fromkeys((name for (name,) in named), "REAL")
        if sorted(found) != sorted(columns.items()):
            raise sqlite3.DatabaseError(f"its table {table!r} has other columns")
    for table in ("trials", *SMALL_TABLES):  # motions are many, and few of them are read
        (result,) = connection.execute(f"PRAGMA integrity_check({table})").fetchone()
        if result != "ok":
            raise sqlite3.DatabaseError(" ".join(result.split()))
    for table in SMALL_TABLES:
        rows = connection.execute(f"SELECT * FROM {table}")
        for number, (*values, known) in enumerate(rows, start=1):
            # Runs get other numbers where stores are merged.
            if checksum(*(values[1:] if table == "runs" else values)) != known:
                raise sqlite3.DatabaseError(
                    f"row {number} of its table {table!r} differs from its checksum"
                )


def said(error: object) -> str:
    """What an error says, on one line, without what may be stored."""
    return cut("".join(letter if letter.isprintable() else " " for letter in str(error)))


def is_undecodable(error: sqlite3.Error) -> bool:
    """Whether an error tells of a stored text that is not UTF-8."""
    return "decode to UTF-8" in str(error)


def damage(connection: sqlite3.Connection) -> UserError:
    """What is wrong with the first damaged trial of a store, found slowly."""
    metrics = metric_columns(connection)
    columns = COLUMNS | dict.fromkeys(metrics, "REAL")
    sums = Checksums(metrics)
    (_, _, path) = connection.execute("PRAGMA database_list").fetchone()
    usual = connection.text_factory
    connection.text_factory = lambda text: text.decode("utf-8", "surrogateescape")
    try:
        for number, *row, known in connection.execute(
            f"SELECT rowid, {quoted(columns)}, checksum FROM trials NOT INDEXED"
        ):
            values = dict(zip(columns, row, strict=True))
            fault = _fault(values, columns) or _other_shape(connection, number, values)
            if fault is None and sums.of(tuple(row)) != known:
                fault = "its values differ from its checksum"
            if fault is not None:
                return _error(path, f"row {number} ({_described(values)}): {fault}")
    finally:
        connection.text_factory = usual
    return _error(path, "its rows cannot be read")


def _error(path: str, what: str) -> UserError:
    return UserError(
        f"{Path(path)} is damaged: {cut(what)}; it was left as it is: restore it from a copy, or "
        "move it away and run again"
    )


def _described(row: Mapping[str, Any]) -> str:
    names = ("estimator", "scenario", "sensor", "sigma", "seed")
    return ", ".join(
        value if isinstance(value, str) and value.isprintable() else f"{name} {shown(value)}"
        for name, value in ((name, row[name]) for name in names)
    )


def _fault(row: Mapping[str, Any], columns: Mapping[str, str]) -> str | None:
    for name, kind in columns.items():
        value = row[name]
        if value is None:
            if name in FILLED:
                return f"it has no {name}"
        elif not isinstance(value, _TYPES[kind]):
            return f"{name} is {shown(value)}, not {_CALLED[kind]}"
        elif isinstance(value, str) and not _is_utf8(value):
            return f"{name} is {shown(value)}, which is no text in UTF-8"
    if row["status"] not in STATUSES:
        return f"status {shown(row['status'])} is none of {', '.join(STATUSES)}"
    for name in NESTED:
        if row[name] is not None and _shape(row[name]) is None:
            return f"{name} are {shown(row[name])}, no table of numbers"
    return None


def _is_utf8(text: str) -> bool:
    return not any("\udc80" <= letter <= "\udcff" for letter in text)


def _other_shape(connection: sqlite3.Connection, number: int, row: Mapping[str, Any]) -> str | None:
    """Which table of a row has another shape than those of all others of the same draw."""
    for name in filter(row.get, NESTED):
        others = connection.execute(
            f"SELECT {name} FROM trials WHERE scenario = ? AND salt_id = ? AND seed = ? "
            f"AND {name} IS NOT NULL AND rowid != ?",
            [row["scenario"], row["salt_id"], row["seed"], number],
        )
        shapes, own = {_shape(text) for (text,) in others}, _shape(row[name])
        if own not in shapes and len(shapes) == 1 and None not in shapes:
            here, there = ("{} x {}".format(*one) for one in (own, shapes.pop()) if one)
            return f"{name} are {here} numbers, where others of its draw are {there}"
    return None


def _shape(text: str) -> tuple[int, int] | None:
    """Rows and columns of a table of numbers as JSON; None if it is not one."""
    try:
        rows = msgspec.convert(json.loads(text), list[list[float]])
    except (ValueError, RecursionError):
        return None
    widths = {len(row) for row in rows}
    return (len(rows), widths.pop()) if len(widths) == 1 else None
