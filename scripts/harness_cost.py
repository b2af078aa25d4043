"""Measure the harness's own cost per trial, with an estimator that does nothing.

    python scripts/harness_cost.py --trials 10000
    python scripts/harness_cost.py --trials 10000 --foreign
    python scripts/harness_cost.py --trials 10000 --dask local:2

Both estimators decline every trial: the built-in one, as there is more noise than it was trained
for. A plugin gets a fork of its own for each trial. Exit code 1 if a trial costs 2 ms (12 ms for a
plugin) or more, or memory grows.
"""

import argparse
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import psutil

from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.select import Selection, select
from olne_bench.bench.plan.trial import expand
from olne_bench.bench.run.cluster import run_on_dask
from olne_bench.bench.run.describing import describe_all
from olne_bench.bench.run.executor import run_trials
from olne_bench.bench.run.provenance import provenance
from olne_bench.bench.run.store import open_store

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


def main() -> None:
    """Measure after all workers have started."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=10_000)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--foreign", action="store_true", help="with a plugin")
    parser.add_argument("--dask", help="as for olne-bench run")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        plugin, file = Path(folder, "plugin.py"), Path(folder, "cost.toml")
        plugin.write_text(PLUGIN)
        file.write_text(SUITE)
        suite = load_suite(str(file), (str(plugin),), describe_all)
        chosen = Selection(estimators=("Declines" if arguments.foreign else "neural_posterior",))
        part = select(suite, chosen)
        model = list(expand(part))[-1]
        warm = 500
        trials = (replace(model, seed=seed) for seed in range(warm + arguments.trials))
        if arguments.dask:
            ended = run_on_dask(trials, cluster=arguments.dask)
        else:
            ended = run_trials(trials, jobs=arguments.jobs)
        this = psutil.Process()
        with open_store(Path(folder, "out")) as store:
            text = suite.model_dump_json()
            source = provenance(
                suite=text, suite_text="", selection=chosen, seeds=1, executor="this script"
            )
            store.begin_run(source, [model])
            for number, (trial, outcome) in enumerate(ended):
                if number == warm:
                    started, cpu, memory = time.monotonic(), _cpu(this), _memory(this)
                store.add(trial, outcome)
                if number == warm + arguments.trials - 1:
                    each = (time.monotonic() - started) / arguments.trials
                    own, others = (
                        (now - before) / arguments.trials
                        for now, before in zip(_cpu(this), cpu, strict=True)
                    )
                    growth = {name: size - memory[name] for name, size in _memory(this).items()}
    print(f"{1e3 * each:.2f} ms a trial")
    print(f"computed: {1e3 * own:.2f} ms (driver), {1e3 * others:.2f} ms (referees and players)")
    print(
        "memory grew by " + ", ".join(f"{size:.1f} MiB ({name})" for name, size in growth.items())
    )
    limit = FOREIGN_LIMIT if arguments.foreign else LIMIT
    sys.exit(each >= limit or max(growth.values()) > GROWTH)


def _cpu(driver: psutil.Process) -> tuple[float, float]:
    """Processor time [s] of the driver, and of all its workers together."""
    workers = [child.cpu_times() for child in driver.children(recursive=True)]
    return time.process_time(), sum(one.user + one.system for one in workers)


def _memory(driver: psutil.Process) -> dict[str, float]:
    """Memory [MiB] of the driver and of all workers together."""
    workers = sum(child.memory_info().rss for child in driver.children(recursive=True))
    return {"driver": driver.memory_info().rss / 2**20, "workers": workers / 2**20}


if __name__ == "__main__":
    main()
