"""Measure the harness's own cost per trial, with an estimator that does nothing.

    python scripts/harness_cost.py --trials 10000
    python scripts/harness_cost.py --trials 10000 --foreign
    python scripts/harness_cost.py --trials 10000 --dask local:2

Both estimators decline every trial: the built-in one, as there is more noise than it was trained
for. A plugin gets a fork of its own for each trial. Exit code 1 if a trial costs 2 ms (12 ms for a
plugin) or more, or memory grows.
"""

import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import shared
import numpy as np
import psutil

from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.select import Selection, select
from olne_bench.bench.plan.trial import expand
from olne_bench.bench.run.cluster import run_on_dask
from olne_bench.bench.run.describe_plugins import describe_all
from olne_bench.bench.run.executor import run_trials
from olne_bench.bench.run.provenance import provenance
from olne_bench.bench.run.store import open_store

WARM = 500  # trials that are not measured
LIMIT, FOREIGN_LIMIT = 2e-3, 12e-3  # [s]
GROWTH = 20.0  # [MiB]
SUITE = """
name = "cost"
scenarios = ["two_player"]
sensors = ["full"]
sigmas = [5.0]
seeds = 1
estimators = ["neural_posterior"]
"""
PLUGIN = """
class Declines:
    name = "Declines"

    def supports(self, problem):
        return "never"

    def estimate(self, problem, observation, *, rng, budget):
        raise AssertionError
"""


def main(
    trials: int = 10_000, jobs: int = 2, foreign: bool = False, dask: str | None = None
) -> None:
    """Measure after all workers have started."""
    with tempfile.TemporaryDirectory() as folder:
        plugin, file = Path(folder, "plugin.py"), Path(folder, "cost.toml")
        plugin.write_text(PLUGIN)
        file.write_text(SUITE)
        suite = load_suite(str(file), (str(plugin),), describe_all)
        chosen = Selection(estimators=("Declines" if foreign else "neural_posterior",))
        model = list(expand(select(suite, chosen)))[-1]
        some = (replace(model, seed=seed) for seed in range(WARM + trials))
        ended = run_on_dask(some, cluster=dask) if dask else run_trials(some, jobs=jobs)
        with open_store(Path(folder, "out")) as store:
            source = {"suite": suite.model_dump_json(), "suite_text": "", "executor": "this script"}
            store.begin_run(provenance(selection=chosen, seeds=1, **source), [model])
            for number, (trial, outcome) in enumerate(ended):
                if number == WARM:
                    times, sizes = _times(), _sizes()
                store.add(trial, outcome)
                if number == WARM + trials - 1:  # workers are still there
                    used = 1e3 * (_times() - times) / trials
                    kept = {pid: size for pid, size in _sizes().items() if pid in sizes}
    each, own, others = used
    growth = max(size - sizes[pid] for pid, size in kept.items())
    print(f"{each:.2f} ms a trial")
    print(f"computed: {own:.2f} ms (driver), {others:.2f} ms (referees and players)")
    print(f"memory of {len(kept)} processes grew by {growth:.1f} MiB at most")
    too_long = each >= 1e3 * (FOREIGN_LIMIT if foreign else LIMIT)
    sys.exit(too_long or growth > GROWTH)


def _times() -> np.ndarray:
    """Wall-clock time, and processor time of the driver and of all its workers [s]."""
    others = 0.0
    for worker in psutil.Process().children(recursive=True):
        with suppress(psutil.NoSuchProcess):  # a plugin's process lives for one trial
            others += sum(worker.cpu_times()[:4])  # with that of its children that have ended
    return np.array([time.monotonic(), time.process_time(), others])


def _sizes() -> dict[int, float]:
    """Memory [MiB] of the driver and each of its workers, by process id."""
    found, this = {}, psutil.Process()
    for worker in (this, *this.children(recursive=True)):
        with suppress(psutil.NoSuchProcess):
            found[worker.pid] = worker.memory_info().rss / 2**20
    return found


if __name__ == "__main__":
    shared.command(main)
