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
from dataclasses import replace
from pathlib import Path

import shared
import psutil

from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.select import Selection, select
from olne_bench.bench.plan.trial import expand
from olne_bench.bench.run.cluster import run_on_dask
from olne_bench.bench.run.describing import describe_all
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
                    before = _used()
                store.add(trial, outcome)
                if number == WARM + trials - 1:  # workers are still there
                    used = {name: amount - before[name] for name, amount in _used().items()}
    each, own, others = (1e3 * used.pop(name) / trials for name in ("wall", "own", "others"))
    print(f"{each:.2f} ms a trial")
    print(f"computed: {own:.2f} ms (driver), {others:.2f} ms (referees and players)")
    print("memory grew by " + ", ".join(f"{size:.1f} MiB ({name})" for name, size in used.items()))
    too_long = each >= 1e3 * (FOREIGN_LIMIT if foreign else LIMIT)
    sys.exit(too_long or max(used.values()) > GROWTH)


def _used() -> dict[str, float]:
    """Wall-clock and processor time [s], and memory [MiB], of the driver and of all its workers."""
    this = psutil.Process()
    workers = this.children(recursive=True)
    times = [worker.cpu_times() for worker in workers]
    sizes = sum(worker.memory_info().rss for worker in workers)
    return {
        "wall": time.monotonic(),
        "own": time.process_time(),
        "others": sum(one.user + one.system for one in times),
        "driver": this.memory_info().rss / 2**20,
        "workers": sizes / 2**20,
    }


if __name__ == "__main__":
    shared.command(main)
