"""A worker process seen from outside: started, given tasks, watched, killed, replaced.

Process pools of libraries were tried first. What is needed here and was not to be had together: a
limit per task on a monotonic clock, a process killed while it holds the pool's lock that does not
stop the pool, an exit with code 0 that is noticed, and children of a task that die with it. With a
pipe and a process group per worker there is nothing that two of them share.
"""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from multiprocessing.connection import Connection, wait
from pathlib import Path
from pickle import UnpicklingError
from typing import Generic, Protocol, TypeVar

from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.run.referee_loop import READY, Answer, Stage
from olne_bench.errors import UserError

#: Seconds that a process may take to import everything, from a slow network file system too.
START_LIMIT = 300.0
#: How often a task whose process was killed from outside is tried.
ATTEMPTS = 3
#: How long a process may still be there after its connection is closed [s].
_DEATH_SECONDS = 5.0
#: Whoever waits for several workers looks after them this often [s].
TICK = 0.2

# Threads would compete with the other workers, and sum in another order, which is enough to change
# where an interior-point method ends up in a hopeless game. Likewise an order of sets.
_ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "VECLIB_MAXIMUM_THREADS": "1",
    "PYTHONHASHSEED": "0",
}
_KILLED_FROM_OUTSIDE = {-signal.SIGKILL, -signal.SIGTERM}


class Task(Protocol):
    """What a worker can be given; a trial, for one."""

    @property
    def time_limit(self) -> float:
        """Wall-clock seconds that each of its stages may take."""

    @property
    def plugin(self) -> str:
        """What foreign code it runs, empty for none: a process gets to know no two of them."""


T = TypeVar("T", bound=Task)


class WorkerProcess(Generic[T]):
    """One worker; its process is started with its first task and replaced when it dies.

    It is replaced too before a task with other foreign code, or with none, than it has run: what
    that has changed in the process is not for others.

    Attributes:
        task: what it is at, None while idle.
    """

    def __init__(
        self,
        function: Callable[[T, Callable[[str], None]], Outcome],
        *,
        log: Path | None,
        memory: int | None,
    ) -> None:
        """Nothing is started yet.

        Args:
            function: what is done with each task; a module has to hold it. It is given the task
                and what it may tell the names of stages as they begin.
            log: file for whatever estimators print; this process's standard error where absent.
            memory: limit [bytes] of each process, None for no limit.
        """
        self.task: T | None = None
        self._function = function
        self._log = log
        self._memory = memory
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection | None = None
        self._ready = False
        self._served = 0
        self._attempts = 0
        self._deadline = 0.0
        self._stage = ""
        self._plugin = ""

    @property
    def connection(self) -> Connection:
        """Readable when there may be something for ``poll`` to find."""
        assert self._connection is not None
        return self._connection

    def assign(self, task: T) -> None:
        """Give an idle worker its next task."""
        assert self.task is None
        self._attempts = 0
        self._send(task)

    def poll(self) -> Outcome | None:
        """The outcome of the task, or None while it runs. Never waits.

        Raises:
            UserError: where processes do not start, or see other code than the task was made for.
        """
        assert self.task is not None
        try:
            while self.connection.poll():
                message = self.connection.recv()
                if isinstance(message, Stage):
                    self._stage = message.name
                elif message == READY:
                    self._ready = True
                else:
                    return self._take(message)
                self._deadline = time.monotonic() + self.task.time_limit
        except (EOFError, OSError, UnpicklingError):
            return self._bury("closed its connection")
        assert self._process is not None
        if self._process.poll() is not None:
            return self._bury("")
        if time.monotonic() > self._deadline:
            return self._run_out()
        return None

    def wait(self) -> Outcome:
        """The outcome of the task, once there is one."""
        while (outcome := self.poll()) is None:
            wait([self.connection], timeout=TICK)
        return outcome

    def stop(self) -> None:
        """Kill the process with all that it started."""
        if self._process is not None:
            # The group outlives its leader if an estimator has started processes.
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
            self.connection.close()
        self._process = self._connection = None
        self._plugin = ""

    def _send(self, task: T) -> None:
        self.task = task
        if self._plugin not in ("", task.plugin):
            self.stop()
        if self._process is None:
            self._start()
        self._plugin = task.plugin
        self._stage = ""
        limit = task.time_limit if self._ready else START_LIMIT
        self._deadline = time.monotonic() + limit
        with suppress(OSError):  # it is dead already, which ``poll`` will find
            self.connection.send((self._function, task))

    def _start(self) -> None:
        ours, theirs = socket.socketpair()
        call = f"serve({theirs.fileno()}, {os.getpid()}, {self._memory})"
        loop = "from olne_bench.bench.run.referee_loop import serve"
        boot = f"import sys; sys.path[:] = {sys.path!r}; {loop}; {call}"
        with theirs, ExitStack() as stack:
            output = stack.enter_context(self._log.open("ab")) if self._log else sys.__stderr__
            self._process = subprocess.Popen(
                [sys.executable, "-u", "-c", boot],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                env=os.environ | _ENVIRONMENT,
                pass_fds=[theirs.fileno()],
                start_new_session=True,  # it gets no Ctrl-C of the terminal's
            )
        self._connection = Connection(ours.detach())
        self._ready = False
        self._served = 0

    def _take(self, message: Answer | str) -> Outcome:
        if isinstance(message, str):
            self.stop()
            raise UserError(message)
        self._served += 1
        self.task = None
        if message.retire:
            self.stop()
        return message.outcome

    def _run_out(self) -> Outcome:
        assert self.task is not None
        if not self._ready:
            self.stop()
            raise UserError(f"a worker process did not start within {START_LIMIT:g} s")
        message = f"killed after {self.task.time_limit:g} s"
        if self._stage:
            message += f" of {self._stage}"
        self.stop()
        self.task = None
        return Outcome("timeout", message)

    def _bury(self, last_words: str) -> Outcome | None:
        """The process is dead: the task's fault, or should it be tried once more?"""
        assert self.task is not None and self._process is not None
        try:
            code = self._process.wait(timeout=_DEATH_SECONDS)
            cause = _death(code)
        except subprocess.TimeoutExpired:
            code, cause = 0, last_words
        ready, served = self._ready, self._served
        self.stop()
        self._attempts += 1
        task, self.task = self.task, None
        # A process that has run other tasks may have died of what they left behind.
        doubtful = served > 0 or code in _KILLED_FROM_OUTSIDE or not ready
        if doubtful and self._attempts < ATTEMPTS:
            self._send(task)
            return None
        if not ready:
            place = "standard error" if self._log is None else self._log
            raise UserError(f"worker processes do not start: the process {cause}; see {place}")
        return Outcome("crash", f"the process {cause}")


def _death(code: int) -> str:
    if code >= 0:
        return f"died with exit code {code}"
    try:
        return f"was killed by {signal.Signals(-code).name} (signal {-code})"
    except ValueError:
        return f"was killed by signal {-code}"
