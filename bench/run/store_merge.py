"""Add the rows and runs of one store to another."""

import sqlite3
from pathlib import Path

from olne_bench.bench.run.provenance import Provenance, read_provenance
from olne_bench.bench.run.store_layout import (
    COLUMNS,
    CURRENT,
    NAMED,
    add_metric_columns,
    metric_columns,
    quoted,
)
from olne_bench.errors import UserError


def merge_stores(connection: sqlite3.Connection, other: Path) -> tuple[int, int]:
    """Add the rows, runs, truths and motions of another store in one commit.

    Args:
        connection: connection to the store that is written to.
        other: file of the other store, which is only read.

    Returns:
        Number of new rows, and number of rows that were here already and are unchanged.

    Raises:
        UserError: if the two have run different code, or parameters, under the same name.
    """
    connection.execute("ATTACH DATABASE ? AS other", [str(other)])
    try:
        _refuse_other_versions(connection, other)
        with connection:
            connection.execute("BEGIN IMMEDIATE")
            return _merge(connection)
    finally:
        connection.execute("DETACH DATABASE other")


def _refuse_other_versions(connection: sqlite3.Connection, other: Path) -> None:
    match = " AND ".join(f"a.{name} = b.{name}" for name in NAMED)
    for what in CURRENT:
        found = connection.execute(
            f"SELECT a.scenario, a.sensor, a.estimator, a.{what}, b.{what} FROM main.current a "
            f"JOIN other.current b ON {match} WHERE a.{what} != b.{what}"
        ).fetchone()
        if found:
            scenario, sensor, estimator, here, there = found
            verb = "are" if what == "parameters" else "is"
            cause = _environments(connection) if what == "environment_version" else ""
            raise UserError(
                f"cannot merge {other}: {what.replace('_', ' ')} of {estimator!r} on {scenario!r}, "
                f"{sensor!r}, {verb} {there or 'unknown'} there and {here or 'unknown'} here"
                f"{cause}; run one of the two again with the other's"
            )


def _environments(connection: sqlite3.Connection) -> str:
    """Differences between the environments of the last runs, in parentheses."""
    here, there = _last_run(connection, "main"), _last_run(connection, "other")
    if here is None or there is None:
        return ""
    differing = [
        f"{name} {there.environment.get(name, '?')} there, {here.environment.get(name, '?')} here"
        for name in sorted({*here.environment, *there.environment})
        if here.environment.get(name) != there.environment.get(name)
    ]
    return f" ({'; '.join(differing)})" if differing else ""


def _last_run(connection: sqlite3.Connection, schema: str) -> Provenance | None:
    row = connection.execute(
        f"SELECT provenance FROM {schema}.runs ORDER BY id DESC LIMIT 1"
    ).fetchone()
    return read_provenance(row[0]) if row else None


def _merge(connection: sqlite3.Connection) -> tuple[int, int]:
    execute = connection.execute
    metrics = metric_columns(connection, "other")
    add_metric_columns(connection, metrics)
    (offset,) = execute("SELECT coalesce(max(id), 0) FROM main.runs").fetchone()
    execute(
        "INSERT INTO main.runs (id, provenance, checksum) "
        "SELECT id + ?, provenance, checksum FROM other.runs ORDER BY id",
        [offset],
    )
    execute("INSERT OR IGNORE INTO main.current SELECT * FROM other.current")
    names = quoted((*COLUMNS, *metrics))
    new = execute(
        f"INSERT OR IGNORE INTO main.trials ({names}, checksum, run) "
        f"SELECT {names}, checksum, run + ? FROM other.trials",
        [offset],
    ).rowcount
    for table in ("scenes", "motions"):
        execute(f"INSERT OR IGNORE INTO main.{table} SELECT * FROM other.{table}")
    (rows,) = execute("SELECT count(*) FROM other.trials").fetchone()
    return new, rows - new
