"""Run some rows of a published table again, and say which numbers differ and by how much.

    python scripts/repeated_rows.py results/paper/trials.parquet paper --estimator kkt_residual

A column is equal if all its values are, bit by bit. Of the others, the median and the largest
relative difference are shown. It also names trials whose status changed, and says whether the
environment of the rows is the present one. Exit code 1 if any number differs.
"""

import random
import sys
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import shared
import numpy as np
from pyarrow import parquet

from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import KEY_COLUMNS, Trial, in_order_of_plugins
from olne_bench.bench.run.executor import run_trials

#: They depend on the machine, or enter no table.
FREE = ("message", "extras", "solve_seconds", "trial_seconds")


def main(
    table: Path,
    suite: str,
    estimator: tuple[str, ...] = (),
    number: int = 40,
    seed: int = 0,
    jobs: int = 2,
) -> None:
    """Command line."""
    rows = parquet.read_table(table).to_pylist()
    if estimator:
        rows = [row for row in rows if row["estimator"] in estimator]
    chosen = random.Random(seed).sample(rows, min(number, len(rows)))
    known = {_key(row): row for row in chosen}
    trials = [t for t in in_order_of_plugins(load_suite(suite)) if t.key in known]
    ended = list(run_trials(trials, jobs=jobs))
    _say_environments(known.values(), trials)
    sys.exit(int(_compare(known, ended)))


def _key(row: dict[str, Any]) -> tuple[str, ...]:
    return tuple(str(row[name]) for name in KEY_COLUMNS)


def _say_environments(rows: Iterable[dict[str, Any]], trials: list[Trial]) -> None:
    there = ", ".join(sorted({row["environment_version"] for row in rows}))
    here = ", ".join(sorted({trial.versions.environment for trial in trials}))
    print(f"environment of the rows: {there}, here: {here}")


def _compare(known: dict[tuple[str, ...], Any], ended: list[tuple[Trial, Outcome]]) -> bool:
    """Print what differs; return whether anything does."""
    differences: dict[str, list[float]] = {}
    for trial, outcome in ended:
        row, again = known[trial.key], asdict(outcome)
        again |= again.pop("scores")
        for name in sorted(set(again) - set(FREE)):
            differences.setdefault(name, []).append(_difference(row.get(name), again[name]))
        if row["status"] != outcome.status:
            print(f"{', '.join(trial.key)}: {row['status']} there, {outcome.status} here")
    print(f"{len(ended)} rows; equal in all: ", end="")
    print(", ".join(name for name, found in differences.items() if not any(found)))
    for name, found in differences.items():
        changed = [one for one in found if one]
        if changed:
            print(
                f"{name}: {len(changed)} rows differ, relatively by {np.median(changed):.1g} in "
                f"the median, {max(changed):.1g} at most"
            )
    return any(any(found) for found in differences.values())


def _difference(there: Any, here: Any) -> float:
    """Largest relative difference; infinity where only one is a number, or texts differ."""
    if isinstance(there, str) or isinstance(here, str):
        return 0.0 if there == here else np.inf
    one, other = _numbers(there), _numbers(here)
    if one.shape != other.shape or (np.isnan(one) != np.isnan(other)).any():
        return np.inf
    scale = np.maximum(np.maximum(np.abs(one), np.abs(other)), np.finfo(float).tiny)
    return float(np.nan_to_num(np.abs(one - other) / scale).max(initial=0.0))


def _numbers(value: Any) -> np.ndarray:
    return np.array(np.nan if value is None else value, dtype=float)


if __name__ == "__main__":
    shared.command(main)
