"""Run trials in worker processes of this machine, each with a hard time limit.

A trial that hangs is killed at its limit and one that takes its process down loses only itself:
the process is replaced and the others go on.
"""

import itertools
from collections.abc import Callable, Iterable, Iterator
from multiprocessing.connection import wait
from pathlib import Path

from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import Trial
from olne_bench.bench.run.referee_loop import run_trial
from olne_bench.bench.run.referee_process import TICK, WorkerProcess


def never() -> bool:
    """Says that nobody wants a run to stop."""
    return False


def run_trials(
    trials: Iterable[Trial],
    *,
    jobs: int,
    log: Path | None = None,
    memory: int | None = None,
    stop: Callable[[], bool] = never,
) -> Iterator[tuple[Trial, Outcome]]:
    """Run trials in parallel; yields each with its outcome as it ends.

    Args:
        trials: what to run; read lazily.
        jobs: number of worker processes.
        log: file for whatever estimators print; standard error where absent.
        memory: limit [bytes] of each process's memory, None for no limit.
        stop: asked several times a second; once true, what has ended is yielded and no more.

    Raises:
        UserError: where processes do not start, or the code changes meanwhile.
    """
    source = iter(trials)
    workers = [WorkerProcess(run_trial, log=log, memory=memory) for _ in range(jobs)]
    try:
        for worker, trial in zip(workers, itertools.islice(source, jobs), strict=False):
            worker.assign(trial)
        while busy := [worker for worker in workers if worker.task is not None]:
            stopping = stop()
            if not stopping:
                wait([worker.connection for worker in busy], timeout=TICK)
            ended = []
            for worker in busy:
                at_work = worker.task
                outcome = worker.poll()
                if at_work is None or outcome is None:
                    continue
                ended.append((at_work, outcome))
                following = None if stopping else next(source, None)
                if following is not None:
                    worker.assign(following)  # it works while its last outcome is stored
            yield from ended
            if stopping:
                return
    finally:
        for worker in workers:
            worker.stop()
