"""Measure the time and memory of the report of a large store, with its page.

    python scripts/large_report.py --trials 1000000 [--copies 5] [--figures]

The rows are those of ``results/paper``, or of another table and its suite, repeated as if they were
of more noise draws, and with ``--copies`` of more scenarios. The report is made with what the suite
says of scenarios and metrics.
"""

import json
import resource
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from itertools import islice, product
from pathlib import Path

import shared
import numpy as np
import pandas as pd

from olne_bench.bench.judge.scene import pack_truth
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.outcome import NESTED
from olne_bench.bench.plan.select import Selection
from olne_bench.bench.plan.suite import Suite, salt_id
from olne_bench.bench.plan.versions import VERSION_COLUMNS
from olne_bench.bench.run.provenance import provenance
from olne_bench.bench.run.store import open_store
from olne_bench.bench.run.store_check import Checksums, as_stored, checksum
from olne_bench.bench.run.store_layout import (
    COLUMNS,
    CURRENT,
    FILE_NAME,
    NAMED,
    add_metric_columns,
    quoted,
)
from olne_bench.bench.submission.played import played_study

SEEDS = 1000  # more than the study has


def main(
    trials: int = 1_000_000,
    copies: int = 1,
    suite: str = "paper",
    table: Path = Path("results/paper/trials.parquet"),
    figures: bool = False,
) -> None:
    """Make the store and report on it."""
    with tempfile.TemporaryDirectory() as folder:
        started = time.monotonic()
        rows_of = load_suite(suite)
        _fill(Path(folder), rows_of, table, trials, copies)
        print(f"built in {time.monotonic() - started:.0f} s", flush=True)
        size = Path(folder, FILE_NAME).stat().st_size / 2**20
        command = [sys.executable, "-m", "olne_bench", "report", folder]
        command += [] if figures else ["--no-figures"]
        started = time.monotonic()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        seconds = time.monotonic() - started
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        computing, peak = used.ru_utime + used.ru_stime, used.ru_maxrss / 2**20
        page = Path(folder, "index.html").stat().st_size / 2**20
    print(
        f"{trials} trials of {len(rows_of.scenarios) * copies} scenarios, "
        f"{size:.0f} MiB: {seconds:.1f} s, of which {computing:.1f} s "
        f"computing, peak {peak:.2f} GiB, page {page:.2f} MiB"
    )


def _fill(folder: Path, suite: Suite, table: Path, count: int, copies: int) -> None:
    """Store rows of a suite, with its metrics and its provenance."""
    labels = {
        entry.label: [f"{entry.label} {k + 1}" if k else entry.label for k in range(copies)]
        for entry in suite.scenarios
    }
    entries = (
        entry.model_copy(update={"label": label})
        for entry in suite.scenarios
        for label in labels[entry.label]
    )
    suite = suite.model_copy(update={"scenarios": tuple(entries)})
    told = {"suite": suite.model_dump_json(), "suite_text": "", "executor": "rows repeated"}
    with open_store(folder) as store:
        store.begin_run(provenance(selection=Selection(), seeds=suite.seeds, **told), [])
    known = pd.read_parquet(table)
    metrics = sorted(entry.column for entry in suite.metrics if entry.column in known)
    columns, sums = COLUMNS | dict.fromkeys(metrics, "REAL"), Checksums(metrics)
    names, places = quoted((*columns, "checksum")), ", ".join("?" * (len(columns) + 1))
    with closing(sqlite3.connect(folder / FILE_NAME)) as connection, connection:
        connection.create_function("checksum", -1, checksum)
        add_metric_columns(connection, metrics)
        rows = _rows(known.reindex(columns=list(columns)), count, labels)
        stored = (tuple(map(as_stored, row, columns.values())) for row in rows)
        insert = f"INSERT INTO trials ({names}) VALUES ({places})"
        connection.executemany(insert, ((*row, sums.of(row)) for row in stored))
        _add_truths(connection, suite)


def _add_truths(connection: sqlite3.Connection, suite: Suite) -> None:
    """Store a truth of each scenario and sensor, a family's of seed 0; motions are left out."""
    names = (*NAMED, *CURRENT)
    study, truths = played_study([suite]), {}
    for row in connection.execute(f"SELECT DISTINCT {quoted(names)} FROM trials").fetchall():
        connection.execute(
            f"INSERT OR REPLACE INTO current VALUES ({', '.join('?' * (len(row) + 1))})",
            (*row, checksum(*row)),
        )
        told = dict(zip(names, row, strict=True))
        place = told["scenario"], told["sensor"]
        code = checksum(*(told[n] for n in VERSION_COLUMNS if n != "estimator_version"))
        if place not in truths:
            truths[place] = pack_truth(study.scenes.truth(place[0], 0, place[1]))
        of_draw = 0 if study.scenario(place[0]).family else -1  # a fixed one is of any seed
        scene = (place[0], of_draw, salt_id(suite.salt), place[1], code, truths[place])
        connection.execute("INSERT OR REPLACE INTO scenes VALUES (?, ?, ?, ?, ?, ?)", scene)


def _rows(
    known: pd.DataFrame, count: int, labels: Mapping[str, Sequence[str]]
) -> Iterator[tuple[object, ...]]:
    """Rows of a table, over and over: each copy has another label, or other noise draws."""
    for name in set(NESTED) & set(known):
        texts = [None if w is None else json.dumps(np.stack(w).tolist()) for w in known[name]]
        known = known.assign(**{name: pd.Series(texts, known.index, dtype=object)})
    templates = known.astype(object).where(known.notna(), None).to_dict("records")
    for copy, row in islice(product(range(count), templates), count):
        names = labels[row["scenario"]]
        seed = row["seed"] + SEEDS * (copy // len(names))
        yield tuple((row | {"scenario": names[copy % len(names)], "seed": seed}).values())


if __name__ == "__main__":
    shared.command(main)
