"""How a suite scales on Dask workers of this machine, and what it would take on more cores.

    python scripts/dask_scaling.py --seeds 4 --scenario highway --estimator map --workers 1 2 4
    python scripts/dask_scaling.py --seeds 4 --estimator map --costs runs/roads --cores 64

The same trials run on each number of workers, after a run that is not measured and compiles their
games. *Ideal* are as many times the trials of one worker as there are workers, and not more than
there are cores. With ``--costs`` the whole suite is estimated from what the trials of a finished
or interrupted run took, by scenario and estimator.
"""

import argparse
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from olne_bench.bench.plan.draws import draws_source
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.select import Selection, select
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.plan.trial import Trial, expand
from olne_bench.bench.run.cluster import run_on_dask
from olne_bench.bench.run.store import read_store
from olne_bench.bench.run.time_left import time_left


@dataclass(frozen=True)
class Scaling:
    """What a number of workers did.

    Attributes:
        rate: trials a second, from the first outcome on.
        start: time until the first outcome [s].
        judged: seconds that the trials took, each on its worker.
    """

    rate: float
    start: float
    judged: float


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--suite", default="roads")
    parser.add_argument("--scenario", action="append", default=[])
    parser.add_argument("--estimator", action="append", default=[])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2, 4])
    parser.add_argument("--costs", type=Path, help="folder of a run of the suite")
    parser.add_argument("--cores", type=int, nargs="+", default=[1, 16, 64])
    options = parser.parse_args()
    suite = load_suite(options.suite)
    chosen = Selection(
        scenarios=tuple(options.scenario), estimators=tuple(options.estimator), seeds=options.seeds
    )
    part = select(suite, chosen)
    draws = draws_source(options.suite, suite)  # else each trial solves its draw
    trials = [replace(trial, draws=draws) for trial in expand(part, options.seeds)]
    _measured(trials, 2)  # compiles
    print(f"{len(trials)} trials of {suite.name}, {os.cpu_count()} cores")
    print("workers  trials/s  of ideal [%]  seconds a trial  start [s]")
    first = None
    for workers in options.workers:
        one = _measured(trials, workers)
        first = first or one.rate / workers
        ideal = first * min(workers, os.cpu_count() or 1)
        share = 100 * one.rate / ideal
        each = one.judged / len(trials)
        print(
            f"{workers:7}  {one.rate:8.2f}  {share:12.0f}  {each:15.3f}  {one.start:9.1f}",
            flush=True,
        )
    if options.costs:
        for line in _whole(suite, options.costs, options.cores):
            print(line)


def _measured(trials: list[Trial], workers: int) -> Scaling:
    began = time.monotonic()
    first, judged, number = began, 0.0, 0
    for number, (_, outcome) in enumerate(run_on_dask(trials, cluster=f"local:{workers}")):
        if number == 0:
            first = time.monotonic()
        judged += outcome.trial_seconds or 0.0
    return Scaling(number / (time.monotonic() - first), first - began, judged)


def _whole(suite: Suite, folder: Path, cores: list[int]) -> Iterator[str]:
    """What the whole suite takes, by the costs of a run in a folder."""
    with read_store(folder) as store:
        costs = store.costs()
    counts: dict[tuple[str, str], int] = {}
    for trial in expand(suite):
        key = trial.scenario.label, trial.estimator.label
        counts[key] = counts.get(key, 0) + 1
    seconds = 0.0
    for left in time_left(counts, costs):
        seconds += left.seconds
        yield f"{left.estimator}: {left.trials} trials, {left.seconds / 3600:.2f} core hours"
    for number in cores:
        yield f"all on {number} cores: {seconds / 3600 / number:.2f} hours"


if __name__ == "__main__":
    main()
