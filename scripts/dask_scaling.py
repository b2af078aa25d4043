"""How a suite scales on Dask workers of this machine, and what it would take on more cores.

    python scripts/dask_scaling.py --seeds 4 --scenario highway --estimator map --workers 1 2 4
    python scripts/dask_scaling.py --seeds 4 --estimator map --costs runs/roads --cores 64

The same trials run on each number of workers, after a run that is not measured and compiles their
games. *Ideal* are as many times the trials of one worker as there are workers, and not more than
there are cores. With ``--costs`` the whole suite is estimated from what the trials of a finished
or interrupted run took, by scenario and estimator.
"""

import os
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import shared

from olne_bench.bench.plan.draws import draws_source
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.select import Selection, select
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.plan.trial import Trial, expand
from olne_bench.bench.run.cluster import run_on_dask
from olne_bench.bench.run.store import read_store
from olne_bench.bench.run.time_left import time_left


def main(
    suite: str = "roads",
    scenario: tuple[str, ...] = (),
    estimator: tuple[str, ...] = (),
    seeds: int = 3,
    workers: tuple[int, ...] = (1, 2, 4),
    costs: Path | None = None,
    cores: tuple[int, ...] = (1, 16, 64),
) -> None:
    """Command line."""
    whole = load_suite(suite)
    chosen = Selection(scenarios=tuple(scenario), estimators=tuple(estimator), seeds=seeds)
    part = select(whole, chosen)
    draws = draws_source(suite, whole)  # else each trial solves its draw
    trials = [*expand(part, seeds, draws)]
    _measured(trials, 2)  # compiles
    print(f"{len(trials)} trials of {whole.name}, {os.cpu_count()} cores")

    def rows() -> Iterator[dict[str, object]]:
        first = None
        for number in workers:
            rate, start, judged = _measured(trials, number)
            first = first or rate / number
            yield {
                "workers": number,
                "trials/s": f"{rate:.2f}",
                "of ideal [%]": f"{100 * rate / (first * min(number, os.cpu_count() or 1)):.0f}",
                "seconds a trial": f"{judged / len(trials):.3f}",
                "start [s]": f"{start:.1f}",
            }

    shared.show(rows())
    if costs:
        for line in _whole(whole, costs, cores):
            print(line)


def _measured(trials: list[Trial], workers: int) -> tuple[float, float, float]:
    """Trials a second from the first outcome on, the time until it, and that of trials [s]."""
    began = time.monotonic()
    first, judged, number = began, 0.0, 0
    for number, (_, outcome) in enumerate(run_on_dask(trials, cluster=f"local:{workers}")):
        if number == 0:
            first = time.monotonic()
        judged += outcome.trial_seconds or 0.0
    return number / (time.monotonic() - first), first - began, judged


def _whole(suite: Suite, folder: Path, cores: Sequence[int]) -> Iterator[str]:
    """What the whole suite takes, by the costs of a run in a folder."""
    with read_store(folder) as store:
        costs = store.costs()
    counts = Counter((one.scenario.label, one.estimator.label) for one in expand(suite))
    seconds = 0.0
    for left in time_left(counts, costs):
        seconds += left.seconds
        yield f"{left.estimator}: {left.trials} trials, {left.seconds / 3600:.2f} core hours"
    for number in cores:
        yield f"all on {number} cores: {seconds / 3600 / number:.2f} hours"


if __name__ == "__main__":
    shared.command(main)
