"""Measure the time and memory of the report of a large store, with its page.

    python scripts/large_report.py --trials 1000000 [--figures]

The rows are those of ``results/paper``, repeated as if they were of more noise draws.
"""

import argparse
import json
import resource
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from olne_bench.bench.run.store import open_store
from olne_bench.bench.run.store_layout import COLUMNS, FILE_NAME

SEEDS = 1000  # more than the study has


def main() -> None:
    """Make the store and report on it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=1_000_000)
    parser.add_argument("--table", type=Path, default=Path("results/paper/trials.parquet"))
    parser.add_argument("--figures", action="store_true", help="draw the figures as well")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        with open_store(Path(folder)):
            pass
        names = ", ".join(f'"{name}"' for name in COLUMNS)
        places = ", ".join("?" for _ in COLUMNS)
        with sqlite3.connect(Path(folder, FILE_NAME)) as connection:
            connection.executemany(
                f"INSERT INTO trials ({names}) VALUES ({places})",
                _rows(arguments.table, arguments.trials),
            )
        size = Path(folder, FILE_NAME).stat().st_size / 2**20
        command = [sys.executable, "-m", "olne_bench", "report", folder]
        command += [] if arguments.figures else ["--no-figures"]
        started = time.monotonic()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        seconds = time.monotonic() - started
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        computing, peak = used.ru_utime + used.ru_stime, used.ru_maxrss / 2**20
        page = Path(folder, "index.html").stat().st_size / 2**20
    print(
        f"{arguments.trials} trials, {size:.0f} MiB: {seconds:.1f} s, of which {computing:.1f} s "
        f"computing, peak {peak:.2f} GiB, page {page:.2f} MiB"
    )


def _rows(table: Path, count: int) -> Iterator[tuple[object, ...]]:
    known = pd.read_parquet(table)
    known["weights"] = [
        None if w is None else json.dumps(np.stack(w).tolist()) for w in known["weights"]
    ]
    known = known.astype(object).where(known.notna(), None)
    templates = known[list(COLUMNS)].to_dict("records")
    for number in range(count):
        copy, place = divmod(number, len(templates))
        row = templates[place]
        # Each copy has other noise draws.
        yield tuple((row | {"seed": row["seed"] + SEEDS * copy}).values())


if __name__ == "__main__":
    main()
