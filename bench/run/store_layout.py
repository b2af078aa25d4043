"""Layout of a store: one SQLite file per run folder, one row per trial.

Rows of former versions of the code stay; ``current`` holds the version that was last run under a
name. Each metric has a column, which is added by the first run that has it. Each row of each table
has a checksum (``store_check``); truths and motions (``store_scenes``) have that of zlib.
"""

import sqlite3
from collections.abc import Iterable

from olne_bench.bench.plan.outcome import OUTCOME_COLUMNS
from olne_bench.bench.plan.trial import KEY_COLUMNS, LABEL_COLUMNS
from olne_bench.bench.plan.versions import VERSION_COLUMNS

FILE_NAME = "trials.sqlite"
#: Mark the file as a store, and its layout.
APPLICATION_ID = 0x4F4C4E45  # "OLNE"
VERSION = 8

#: Columns of every store, and their types.
COLUMNS = LABEL_COLUMNS | OUTCOME_COLUMNS | VERSION_COLUMNS
#: Rows are current if their values of ``CURRENT`` are those last run under the same ``NAMED``.
NAMED = ("scenario", "sensor", "estimator")
CURRENT = ("parameters", *VERSION_COLUMNS)


_CHECKSUM = {"checksum": "INTEGER"}
_DRAW = {"scenario": "TEXT", "seed": "INTEGER", "salt_id": "TEXT", "sensor": "TEXT"}
#: All tables with their columns; in ``trials``, those of metrics follow, whose names ``metrics``
#: has. ``costs`` has sums over finished trials, for estimates of the time left. ``code`` is a
#: checksum of the versions that a truth or a motion was made with.
TABLES = {
    "trials": COLUMNS | {"run": "INTEGER"} | _CHECKSUM,
    "runs": {"id": "INTEGER", "provenance": "TEXT"} | _CHECKSUM,
    "current": dict.fromkeys((*NAMED, *CURRENT), "TEXT") | _CHECKSUM,
    "metrics": {"name": "TEXT"} | _CHECKSUM,
    "costs": {"scenario": "TEXT", "estimator": "TEXT", "trials": "INTEGER", "seconds": "REAL"}
    | _CHECKSUM,
    "scenes": _DRAW | {"code": "INTEGER", "content": "BLOB"},
    "motions": _DRAW | {"sigma": "REAL", "estimator": "TEXT", "code": "INTEGER", "states": "BLOB"},
}
#: Tables that are read as a whole, and checked, whenever a store is opened.
SMALL_TABLES = ("runs", "current", "metrics", "costs")
_KEYS = {
    "trials": (*KEY_COLUMNS, *VERSION_COLUMNS),
    "runs": ("id",),
    "current": NAMED,
    "metrics": ("name",),
    "costs": ("scenario", "estimator"),
    "scenes": (*_DRAW, "code"),
    "motions": (*_DRAW, "sigma", "estimator", "code"),
}
_WITHOUT_ROWID = ("current", "metrics", "costs")
_ADD_COST = (
    "INSERT INTO costs VALUES (:scenario, :estimator, 1, :seconds, "
    "checksum(:scenario, :estimator, 1, :seconds)) ON CONFLICT DO UPDATE SET "
    "trials = trials + 1, seconds = seconds + excluded.seconds, "
    "checksum = checksum(scenario, estimator, trials + 1, seconds + excluded.seconds)"
)


def create(connection: sqlite3.Connection) -> None:
    """Create the tables of an empty store."""
    for table, columns in TABLES.items():
        named = ", ".join(f'"{name}" {kind}' for name, kind in columns.items())
        kind = "WITHOUT ROWID" if table in _WITHOUT_ROWID else ""
        key = quoted(_KEYS[table])
        connection.execute(f"CREATE TABLE {table} ({named}, PRIMARY KEY ({key})) {kind}")
    connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
    connection.execute(f"PRAGMA user_version = {VERSION}")


def metric_columns(connection: sqlite3.Connection, schema: str = "main") -> list[str]:
    """Names of the metrics that a store has columns for, sorted."""
    found = connection.execute(f"PRAGMA {schema}.table_info(trials)")
    return sorted({row[1] for row in found} - {*TABLES["trials"]})


def add_metric_columns(connection: sqlite3.Connection, names: Iterable[str]) -> None:
    """Add columns for metrics that have none; older rows have no value in them."""
    for name in sorted(set(names) - set(metric_columns(connection))):
        connection.execute(f'ALTER TABLE trials ADD COLUMN "{name}" REAL')
        connection.execute("INSERT INTO metrics VALUES (:name, checksum(:name))", {"name": name})


def add_cost(connection: sqlite3.Connection, scenario: str, estimator: str, seconds: float) -> None:
    """Add the time of one trial [s]."""
    cost = {"scenario": scenario, "estimator": estimator, "seconds": float(seconds)}
    connection.execute(_ADD_COST, cost)


def costs(connection: sqlite3.Connection) -> list[tuple[str, str, int, float]]:
    """Scenario, estimator, number of trials and their seconds in all."""
    return connection.execute("SELECT scenario, estimator, trials, seconds FROM costs").fetchall()


def quoted(columns: Iterable[str], prefix: str = "") -> str:
    """Quoted names of columns for a statement."""
    return ", ".join(f'{prefix}"{name}"' for name in columns)
