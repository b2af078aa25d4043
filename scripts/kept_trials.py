"""Keep trials that took hours in one small file, and make a run folder of them again.

    python scripts/kept_trials.py keep runs/roads slow.parquet --estimator particle
    python scripts/kept_trials.py restore slow.parquet runs/roads

Keeps all columns, numbers in single precision, the versions of the code, what trials have taken,
and the provenance of the last run. ``olne-bench run`` goes on in the restored folder: it runs what
is missing, and trials whose code has changed.
"""

import argparse
import json
import sqlite3
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import parquet

from olne_bench.bench.plan.outcome import NESTED
from olne_bench.bench.run.provenance import provenance_json
from olne_bench.bench.run.store import read_store
from olne_bench.bench.run.store_file import writing
from olne_bench.bench.run.store_layout import (
    COLUMNS,
    CURRENT,
    FILE_NAME,
    NAMED,
    add_metric_columns,
    create_costs,
    quoted,
)
from olne_bench.bench.run.store_table import parquet_options, parse_nested

#: Keys of trials: these keep double precision.
EXACT = ("sigma",)
_RUNS, _COSTS = b"runs", b"costs"


def keep(folder: Path, file: Path, estimators: list[str]) -> int:
    """Write current rows of a run folder to a file; return their number.

    Args:
        folder: the run folder.
        file: Parquet file to write.
        estimators: labels of the estimators whose rows are kept.
    """
    with read_store(folder) as store:
        table = parse_nested(store.table())
        runs = [provenance_json(run) for run in store.runs()]
        costs = [(*place, *cost) for place, cost in store.costs().items() if place[1] in estimators]
    table = table.filter(pc.is_in(table["estimator"], pa.array(estimators)))
    notes = {_RUNS: json.dumps(runs[-1:]), _COSTS: json.dumps(costs)}
    schema = pa.schema([_single(column) for column in table.schema], notes)
    parquet.write_table(table.cast(schema), file, compression_level=19, **parquet_options(schema))
    return table.num_rows


def _single(column: pa.Field) -> pa.Field:
    if column.name in EXACT:
        return column
    if column.name in NESTED:
        return column.with_type(pa.list_(pa.list_(pa.float32())))
    return column.with_type(pa.float32()) if column.type == pa.float64() else column


def restore(file: Path, folder: Path) -> int:
    """Make a run folder of a file that ``keep`` has written; return its number of rows.

    Raises:
        SystemExit: if the folder holds a run already.
    """
    if (folder / FILE_NAME).exists():
        raise SystemExit(f"{folder} holds a run already; restore to another, then merge the two")
    table = parquet.read_table(file)
    runs, costs = (json.loads(table.schema.metadata[name]) for name in (_RUNS, _COSTS))
    rows = table.to_pylist()
    for row in rows:
        row |= {name: json.dumps(row[name]) for name in NESTED if row[name] is not None}
    with writing(folder, FILE_NAME) as connection:
        create_costs(connection)
        add_metric_columns(connection, set(table.column_names) - set(COLUMNS))
        with connection:
            connection.executemany(
                "INSERT INTO runs (provenance) VALUES (?)", [[run] for run in runs]
            )
            connection.executemany("INSERT INTO costs VALUES (?, ?, ?, ?)", costs)
            _insert(connection, table.column_names, rows)
    return len(rows)


def _insert(connection: sqlite3.Connection, names: list[str], rows: list[dict]) -> None:
    values = ", ".join(f":{name}" for name in names)
    connection.executemany(f"INSERT INTO trials ({quoted(names)}, run) VALUES ({values}, 1)", rows)
    connection.execute(
        f"INSERT INTO current SELECT DISTINCT {quoted((*NAMED, *CURRENT))} FROM trials"
    )


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    keeping = commands.add_parser("keep", help="write rows of a run folder to a file")
    keeping.add_argument("folder", type=Path)
    keeping.add_argument("file", type=Path)
    keeping.add_argument("--estimator", action="append", required=True)
    restoring = commands.add_parser("restore", help="make a run folder of a file")
    restoring.add_argument("file", type=Path)
    restoring.add_argument("folder", type=Path)
    given = parser.parse_args()
    if given.command == "keep":
        print(f"{given.file}: {keep(given.folder, given.file, given.estimator)} rows")
    else:
        print(f"{given.folder}: {restore(given.file, given.folder)} rows")


if __name__ == "__main__":
    main()
