"""Run trials in worker processes, each with a hard time limit.

A trial that hangs is killed at its limit and one that takes its process down loses only itself:
``pebble`` replaces the worker and the others go on.
"""

import io
import os
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures import TimeoutError as FutureTimeoutError
from multiprocessing import get_context
from pathlib import Path

from pebble import ProcessExpired, ProcessPool
from threadpoolctl import threadpool_limits

from bench.evaluate import evaluate
from bench.trial import Outcome, Trial


def run_trials(trials: Iterable[Trial], *, jobs: int, log: Path) -> Iterator[tuple[Trial, Outcome]]:
    """Run trials in parallel; yields each with its outcome as it ends.

    Args:
        trials: what to run; read lazily.
        jobs: number of worker processes.
        log: file for whatever estimators print.
    """
    # Workers inherit this before they load a library that reads it. Threads would also sum in
    # another order, which is enough to change where IPOPT ends up in a hopeless game.
    os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
    # Spawned rather than forked: a plugin may have started threads in this process.
    pool = ProcessPool(
        max_workers=jobs, initializer=_start_worker, initargs=(log,), context=get_context("spawn")
    )
    source = iter(trials)
    running: dict[Future[Outcome], Trial] = {}
    finished = False
    try:
        while running or not finished:
            # A short queue keeps workers busy; a long one would keep a large study in memory.
            while not finished and len(running) < 3 * jobs:
                trial = next(source, None)
                if trial is None:
                    finished = True
                else:
                    running[pool.schedule(evaluate, (trial,), timeout=trial.time_limit)] = trial
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                yield running.pop(future), _outcome(future)
    finally:
        pool.stop()
        pool.join()


def _outcome(future: Future[Outcome]) -> Outcome:
    try:
        return future.result()
    except FutureTimeoutError as error:
        return Outcome("timeout", f"killed after {error.args[1]:g} s")
    except ProcessExpired as error:
        return Outcome("crash", f"the process died with exit code {error.exitcode}")


def _start_worker(log: Path) -> None:
    """One thread per worker, and whatever estimators print goes to the log."""
    threadpool_limits(1)
    descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
        os.dup2(descriptor, stream.fileno())
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(line_buffering=True)  # a killed worker's last words count too
    os.close(descriptor)
