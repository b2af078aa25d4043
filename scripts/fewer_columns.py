"""Keep the trials of a large run small: who was run where, what became of it, and main errors.

    python scripts/fewer_columns.py runs/roads/trials.parquet results/roads/trials.parquet

Errors and times are kept in single precision. The whole table has weights, too; anybody gets it
from the same draws with the same command.
"""

import argparse
from pathlib import Path

import pyarrow as pa
from pyarrow import parquet

from olne_bench.bench.run.store_table import parquet_options

LABELS = ["scenario", "sensor", "sigma", "seed", "salt_id", "estimator", "count", "status"]
NUMBERS = ["position_error", "held_out_error", "cosine_error", "parameter_error", "solve_seconds"]
SHARES = ["covers_truth"]


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("trials", type=Path)
    parser.add_argument("out", type=Path)
    given = parser.parse_args()
    known = parquet.read_schema(given.trials).names
    kept = [name for name in (*LABELS, *NUMBERS, *SHARES) if name in known]
    table = parquet.read_table(given.trials, columns=kept)
    for name in set(NUMBERS) & set(kept):
        place = table.schema.get_field_index(name)
        table = table.set_column(place, name, table[name].cast(pa.float32()))
    parquet.write_table(table, given.out, **parquet_options(table.schema))


if __name__ == "__main__":
    main()
