"""Layout of a store: one SQLite file per run folder, one row per trial.

Rows of former versions of the code stay; ``current`` holds the version that was last run under a
name. Each metric has a column, which is added by the first run that has it.
"""

import sqlite3
from collections.abc import Iterable

from olne_bench.bench.plan.outcome import OUTCOME_COLUMNS
from olne_bench.bench.plan.trial import KEY_COLUMNS, LABEL_COLUMNS
from olne_bench.bench.plan.versions import VERSION_COLUMNS

FILE_NAME = "trials.sqlite"
#: The same for studies in which samples are handed out one by one.
MOTIONS_NAME = "motions.sqlite"
#: Mark the file as a store, and its layout.
APPLICATION_ID = 0x4F4C4E45  # "OLNE"
VERSION = 6

#: Columns of every store, and their types.
COLUMNS = LABEL_COLUMNS | OUTCOME_COLUMNS | VERSION_COLUMNS
#: Rows are current if their values of ``CURRENT`` are those last run under the same ``NAMED``.
NAMED = ("scenario", "sensor", "estimator")
CURRENT = ("parameters", *VERSION_COLUMNS)


#: Sums over finished trials, for estimates of the time left; older stores have none.
_COSTS = (
    "CREATE TABLE IF NOT EXISTS costs (scenario TEXT, estimator TEXT, trials INTEGER, "
    "seconds REAL, PRIMARY KEY (scenario, estimator)) WITHOUT ROWID"
)
_ADD_COST = (
    "INSERT INTO costs VALUES (?, ?, 1, ?) ON CONFLICT DO UPDATE SET trials = trials + 1, "
    "seconds = seconds + excluded.seconds"
)


def create(connection: sqlite3.Connection) -> None:
    """Create the tables of an empty store."""
    columns = ", ".join(f'"{name}" {kind}' for name, kind in COLUMNS.items())
    key = quoted((*KEY_COLUMNS, *VERSION_COLUMNS))
    connection.execute(f"CREATE TABLE trials ({columns}, run INTEGER, PRIMARY KEY ({key}))")
    connection.execute("CREATE TABLE runs (id INTEGER PRIMARY KEY, provenance TEXT)")
    connection.execute(
        f"CREATE TABLE current ({quoted((*NAMED, *CURRENT))}, PRIMARY KEY ({quoted(NAMED)})) "
        "WITHOUT ROWID"
    )
    connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
    connection.execute(f"PRAGMA user_version = {VERSION}")


def metric_columns(connection: sqlite3.Connection, schema: str = "main") -> list[str]:
    """Names of the metrics that a store has columns for, sorted."""
    found = connection.execute(f"PRAGMA {schema}.table_info(trials)")
    return sorted({row[1] for row in found} - {*COLUMNS, "run"})


def add_metric_columns(connection: sqlite3.Connection, names: Iterable[str]) -> None:
    """Add columns for metrics that have none; older rows have no value in them."""
    for name in sorted(set(names) - set(metric_columns(connection))):
        connection.execute(f'ALTER TABLE trials ADD COLUMN "{name}" REAL')


def create_costs(connection: sqlite3.Connection) -> None:
    """Create the table of costs, unless it is there."""
    connection.execute(_COSTS)


def add_cost(connection: sqlite3.Connection, scenario: str, estimator: str, seconds: float) -> None:
    """Add the time of one trial [s]."""
    connection.execute(_ADD_COST, [scenario, estimator, seconds])


def costs(connection: sqlite3.Connection) -> list[tuple[str, str, int, float]]:
    """Scenario, estimator, number of trials and their seconds in all."""
    found = connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'costs'").fetchone()
    return connection.execute("SELECT * FROM costs").fetchall() if found else []


def quoted(columns: Iterable[str], prefix: str = "") -> str:
    """Quoted names of columns for a statement."""
    return ", ".join(f'{prefix}"{name}"' for name in columns)
