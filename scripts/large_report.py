"""Report on a store of many trials, with its page: how long, and with how much memory.

    python scripts/large_report.py --trials 1000000

The rows are made up; the store is one of the ``paper`` suite with more noise draws.
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

from bench.store import COLUMNS, FILE_NAME, open_store
from bench.suite import load_suite

STATUSES = ("ok", "ok", "ok", "ok", "ok", "ok", "ok", "ok", "failed_forward", "not_converged")


def main() -> None:
    """Make the store and report on it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=1_000_000)
    parser.add_argument("--figures", action="store_true", help="draw the figures as well")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        with open_store(Path(folder)):
            pass
        names = ", ".join(f'"{name}"' for name in COLUMNS)
        places = ", ".join("?" for _ in COLUMNS)
        with sqlite3.connect(Path(folder, FILE_NAME)) as connection:
            connection.executemany(
                f"INSERT INTO trials ({names}) VALUES ({places})", _rows(arguments.trials)
            )
        size = Path(folder, FILE_NAME).stat().st_size / 2**20
        command = [sys.executable, "-m", "bench", "report", folder]
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


def _rows(count: int) -> Iterator[tuple[object, ...]]:
    suite = load_suite("paper")
    players = {"two_player": 2, "highway_overtaking": 5}
    cells = [
        (scenario.label, view, sigma, estimator.label)
        for scenario in suite.scenarios
        for view in suite.views
        for estimator in suite.estimators
        for sigma in suite.sigmas
    ]
    rng = np.random.default_rng(0)
    for number in range(count):
        scenario, view, sigma, estimator = cells[number % len(cells)]
        status = STATUSES[rng.integers(len(STATUSES))]
        errors = iter(rng.uniform(size=len(COLUMNS)).tolist())
        known = {
            "suite": suite.name,
            "scenario": scenario,
            "view": view,
            "sigma": sigma,
            "seed": number // len(cells),
            "estimator": estimator,
            "parameters": "{}",
            "count": 1,
            "status": status,
            "message": "" if status == "ok" else "a line that says what was wrong",
            "weights": json.dumps(rng.dirichlet(np.ones(4), players[scenario]).tolist()),
        }
        text = "00112233aabb"  # versions
        yield tuple(
            known.get(name, text if kind == "TEXT" else next(errors))
            for name, kind in COLUMNS.items()
        )


if __name__ == "__main__":
    main()
