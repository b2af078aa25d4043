"""The inside of a worker process: take a task, run it, answer; again until the driver is gone.

A worker outlives its tasks, as solvers are slow to build. What a task leaves behind must not
reach the next one, so a worker in a doubtful state says so and is replaced.
"""

import contextlib
import ctypes
import gc
import io
import os
import resource
import signal
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from olne_bench.bench.judge.referee import describe_error, evaluate
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import Trial, explain_difference
from olne_bench.plugins import PluginError

#: What a worker says once it has imported everything.
READY = "ready"
#: Share of the memory limit that a worker may hold on to between trials.
_KEPT_MEMORY = 0.5

_PR_SET_PDEATHSIG = 1  # linux/prctl.h
_PR_SET_CHILD_SUBREAPER = 36


class OtherCodeError(Exception):
    """The worker has other code than the driver, so its rows would be of another study."""


@dataclass(frozen=True)
class Stage:
    """What a worker says as a stage of a task begins; each has the time limit for itself."""

    name: str


@dataclass(frozen=True)
class Answer:
    """What a worker says about a task.

    Attributes:
        outcome: of the task.
        retire: whether the process is not fit for another one.
    """

    outcome: Outcome
    retire: bool = False


def serve(descriptor: int, parent: int, memory: int | None) -> None:
    """Serve a driver until it closes the connection.

    Args:
        descriptor: of the connection to it.
        parent: its process id.
        memory: limit [bytes] of this process's memory, None for no limit.
    """
    _tie_to_parent(parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the driver, which ends this
    if memory is not None:
        resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
    # A log that cannot be written to is not an estimator's failure.
    sys.stdout = sys.stderr = io.TextIOWrapper(_BestEffort(1, "w"), write_through=True)
    own = os.getpid()
    gc.freeze()  # what is imported stays; to look through it again and again takes time
    connection = Connection(descriptor)
    connection.send(READY)

    def say(message: Answer | Stage | str) -> None:
        if os.getpid() != own:  # the estimator forked, and its child came back here
            os._exit(0)
        connection.send(message)

    while True:
        try:
            function, task = connection.recv()
        except (EOFError, ConnectionResetError):
            return
        say(_answer(function, task, lambda name: say(Stage(name)), memory))


def run_trial(trial: Trial, begin: Callable[[str], None]) -> Outcome:
    """Run a trial with the code that it was made for.

    Args:
        trial: what to run.
        begin: as in ``evaluate``.

    Raises:
        OtherCodeError: if the code here is not the same.
    """
    difference = explain_difference(trial)
    if difference is not None:
        raise OtherCodeError(difference)
    return evaluate(trial, begin)


def _answer(
    function: Callable[[Any, Callable[[str], None]], Outcome],
    task: Any,
    begin: Callable[[str], None],
    memory: int | None,
) -> Answer | str:
    """The answer to a task, or the line that ends the run."""
    threads = threading.active_count()
    try:
        outcome = function(task, begin)
    except (OtherCodeError, PluginError) as error:
        return str(error)
    except MemoryError as error:  # of ours, but with what the estimator has left
        outcome = Outcome("crash", describe_error(error))
    if outcome.status == "crash" and "MemoryError" in outcome.message and memory is not None:
        message = f"out of memory, the limit is {memory / 2**30:.3g} GiB: {outcome.message}"
        return Answer(replace(outcome, message=message), retire=True)
    if _has_children():
        message = "left processes running: whatever an estimator starts has to end with the trial"
        return Answer(Outcome("invalid", message), retire=True)
    left_threads = threading.active_count() > threads
    full = memory is not None and _held_memory() > _KEPT_MEMORY * memory
    return Answer(outcome, retire=left_threads or full)


class _BestEffort(io.FileIO):
    def write(self, data: Any) -> int:
        with contextlib.suppress(OSError):
            super().write(data)
        return len(data)


def _has_children() -> bool:
    try:
        os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
    except ChildProcessError:
        return False
    return True


def _held_memory() -> int:
    """Memory [bytes] that counts towards ``RLIMIT_DATA``; 0 where the system does not tell."""
    try:
        pages = Path("/proc/self/statm").read_text().split()[5]
    except OSError:
        return 0
    return int(pages) * resource.getpagesize()


def _tie_to_parent(parent: int) -> None:
    """End with the parent even in the middle of a hang, and adopt what children leave behind."""
    if sys.platform != "linux":
        return  # a worker at work then ends with its trial, at the latest
    prctl = ctypes.CDLL(None).prctl
    prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
    prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    if os.getppid() != parent:
        os._exit(1)
