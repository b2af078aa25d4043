"""Run trials on a Dask cluster.

Each task is a few trials, which a Dask worker hands to a child process (``referee_process``). So a
hanging or dying trial does not harm the cluster, and limits and rows are the same as on one
machine. Only the driver, which runs here, writes the store.
"""

import importlib.util
import itertools
import logging
import re
import signal
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from concurrent.futures import wait as futures_wait
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import resource_tracker
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import Trial
from olne_bench.bench.process.child import TICK
from olne_bench.bench.run.executor import never
from olne_bench.bench.run.referee import RefereeProcess
from olne_bench.errors import UserError

#: Trials are sent in chunks, as a task costs the scheduler several milliseconds. After this time
#: [s] a worker answers with the part of its chunk that it has done.
_CHUNK_SECONDS = 0.5
_LARGEST_CHUNK = 64
#: Number of chunks in progress per thread of the cluster.
_AHEAD = 3
#: How often the cluster's threads are counted again [s].
_COUNT_SECONDS = 5.0
#: A scheduler that has not answered for this time [s] is given up.
_SILENCE_SECONDS = 60.0
#: How often a chunk may be lost; each time, several of its Dask workers have died.
_LOSSES = 20
_CONNECT_SECONDS = 20.0
#: A scheduler that accepts a connection and then says nothing is given up after this time [s].
_GREETING_SECONDS = 60.0
#: How often starting a local cluster is tried.
_STARTS = 4
#: Most workers of a local cluster.
_MOST_WORKERS = 1024
#: Address of a scheduler; in brackets that of version 6 of the internet protocol.
_ADDRESS = r"(tcp|tls|ws|wss)://(?P<host>[A-Za-z0-9._-]+|\[[0-9A-Fa-f:.]+\]):(?P<port>[0-9]{1,5})"
#: How long Dask may take to close while a user waits [s].
_STOP_SECONDS = 1.5

_idle: SimpleQueue[RefereeProcess] = SimpleQueue()
"""Processes of this Dask worker that wait for their next chunk."""


def run_on_dask(
    trials: Iterable[Trial],
    *,
    cluster: str,
    log: Path | None = None,
    memory: int | None = None,
    hidden: Path | None = None,
    stop: Callable[[], bool] = never,
) -> Iterator[tuple[Trial, Outcome]]:
    """Run trials on a cluster; yield each with its outcome as it ends.

    Args:
        trials: what to run; read lazily.
        cluster: address of a scheduler such as ``tcp://host:8786``, or ``local:N`` for one of N
            workers on this machine.
        log: file for what estimators print on a local cluster; workers elsewhere print to
            their standard error.
        memory: memory limit [bytes] of each process that runs foreign code, None for no limit.
        hidden: folder that foreign code cannot read, as it holds the run.
        stop: called several times a second; once it is true, only ended trials are yielded.

    Raises:
        UserError: if the cluster cannot be reached or is lost, processes do not start on it, or
            its code is not the same as here.
    """
    local = cluster.startswith("local:")
    with _client(cluster, stop) as client:
        if client is not None:
            places = _Places(log if local else None, memory, hidden)
            run: _Run = _Run(client, places, stop)
            yield from run.run(iter(trials))


def check_cluster(cluster: str) -> None:
    """Refuse a cluster that cannot be, before any work is done and anything is written.

    Raises:
        UserError: on an address of another form, if Dask is not installed, or if nobody listens at
            the address.
    """
    kind, _, rest = cluster.partition(":")
    workers = int(rest) if re.fullmatch("[0-9]{1,4}", rest) else 0
    if kind == "local" and not 1 <= workers <= _MOST_WORKERS:
        raise UserError(
            f"--dask {cluster!r}: expected 1 to {_MOST_WORKERS} workers, such as local:2"
        )
    found = re.fullmatch(_ADDRESS, cluster)
    if kind != "local" and not (found and 0 < int(found["port"]) < 2**16):
        raise UserError(f"--dask {cluster!r}: expected tcp://host:8786 or local:2")
    if importlib.util.find_spec("distributed") is None:
        raise UserError("--dask needs the package 'distributed': pip install 'olne-bench[dask]'")
    if found:
        _check_listening(cluster, found["host"].strip("[]"), int(found["port"]))


def _check_listening(cluster: str, host: str, port: int) -> None:
    """Refuse an address at which nobody listens, or begins to within ``_CONNECT_SECONDS``."""
    deadline = time.monotonic() + _CONNECT_SECONDS
    while True:
        try:
            socket.create_connection((host, port), timeout=_CONNECT_SECONDS).close()
            return
        except (OSError, UnicodeError) as error:
            if isinstance(error, socket.gaierror | UnicodeError) or time.monotonic() > deadline:
                raise UserError(f"--dask {cluster}: cannot connect ({error})") from error
        time.sleep(TICK)


def run_chunk(
    trials: Sequence[Trial], log: Path | None, memory: int | None, hidden: Path | None
) -> tuple[list[Outcome], float]:
    """Run trials one after the other: the task that is executed on the cluster.

    Args:
        trials: what to run.
        log: as in ``run_on_dask``.
        memory: as in ``run_on_dask``.
        hidden: as in ``run_on_dask``.

    Returns:
        Outcomes of the first trials, at least one and as many as fit into ``_CHUNK_SECONDS``, and
        the time that they took [s].
    """
    try:
        referee = _idle.get_nowait()
    except Empty:
        referee = RefereeProcess(log=log, memory=memory, hidden=hidden)
    outcomes: list[Outcome] = []
    started = time.monotonic()
    try:
        for trial in trials:
            referee.assign(trial)
            outcomes.append(referee.wait())
            seconds = time.monotonic() - started
            if seconds > _CHUNK_SECONDS:
                break
    except BaseException:
        referee.stop()
        raise
    _idle.put(referee)
    return outcomes, seconds


class _Run:
    """Trials on their way to a cluster and back."""

    def __init__(self, client: Any, places: "_Places", stop: Callable[[], bool]) -> None:
        self._client = client
        self._places = places
        self._stop = stop
        self._ended: SimpleQueue[Any] = SimpleQueue()
        self._running: dict[Any, _Chunk] = {}
        self._again: deque[Trial] = deque()
        self._chunk = 1
        self._census = _Census(client)

    def run(self, source: Iterator[Trial]) -> Iterator[tuple[Trial, Outcome]]:
        """Yield trials with their outcomes as they end."""
        self._fill(source)
        while self._running and not self._stop():
            try:
                future = self._ended.get(timeout=TICK)
            except Empty:
                self._check_connection()
                self._fill(source)
            else:
                ended = self._collect(future)
                self._fill(source)
                yield from ended

    def _fill(self, source: Iterator[Trial]) -> None:
        while len(self._running) < _AHEAD * self._census.threads:
            again = [self._again.popleft() for _ in range(min(self._chunk, len(self._again)))]
            trials = again or list(itertools.islice(source, self._chunk))
            if not trials:
                return
            self._submit(_Chunk(trials))

    def _submit(self, chunk: "_Chunk") -> None:
        places = self._places
        future = self._client.submit(
            run_chunk, chunk.trials, places.log, places.memory, places.hidden, pure=False
        )
        self._running[future] = chunk
        future.add_done_callback(self._ended.put)

    def _collect(self, future: Any) -> list[tuple[Trial, Outcome]]:
        """Outcomes of a task; its trials without an outcome are queued again."""
        chunk = self._running.pop(future)
        if future.status != "finished":
            self._lose(future, chunk)
            return []
        outcomes, seconds = future.result()
        done = len(outcomes)
        self._again.extend(chunk.trials[done:])
        # Small when trials are slow, so that the last ones spread over all workers.
        self._chunk = max(1, min(_LARGEST_CHUNK, int(_CHUNK_SECONDS * done / max(seconds, 1e-6))))
        return list(zip(chunk.trials[:done], outcomes, strict=True))

    def _lose(self, future: Any, chunk: "_Chunk") -> None:
        """Run a chunk again if its worker has died; its trials did not fail."""
        from distributed import KilledWorker

        self._check_connection()
        error = future.exception() if future.status == "error" else None
        if isinstance(error, UserError):
            raise error
        if error is not None and not isinstance(error, KilledWorker):
            raise UserError(f"the Dask workers cannot run trials: {type(error).__name__}: {error}")
        if chunk.losses >= _LOSSES:
            raise UserError(
                "Dask workers keep dying; their logs say why. All that has ended is stored: "
                "run the same command again to continue"
            )
        self._submit(_Chunk(chunk.trials, chunk.losses + 1))

    def _check_connection(self) -> None:
        if self._client.status not in ("running", "connecting"):
            raise UserError(
                "the connection to the Dask scheduler is lost. All that has ended is stored: "
                "run the same command again to continue"
            )
        if self._census.silence > _SILENCE_SECONDS:
            raise UserError(
                f"the Dask scheduler has not answered for {_SILENCE_SECONDS:g} s. All that has "
                "ended is stored: run the same command again to continue"
            )


class _Census:
    """Count the cluster's threads in a thread of its own, because a call may never return."""

    def __init__(self, client: Any) -> None:
        self.threads = 1
        self._client = client
        self._answered = time.monotonic()
        threading.Thread(target=self._count, daemon=True).start()

    @property
    def silence(self) -> float:
        """Time since the scheduler has answered [s]."""
        return time.monotonic() - self._answered

    def _count(self) -> None:
        while self._client.status in ("running", "connecting"):
            with suppress(Exception):  # a lost connection is noticed where it matters
                self.threads = max(1, sum(self._client.nthreads().values()))
                self._answered = time.monotonic()
            time.sleep(_COUNT_SECONDS)


@dataclass(frozen=True)
class _Places:
    """Arguments of ``run_chunk`` besides its trials."""

    log: Path | None
    memory: int | None
    hidden: Path | None


@dataclass(frozen=True)
class _Chunk:
    """Trials of one task, and how often they were lost with their worker."""

    trials: list[Trial]
    losses: int = 0


@contextmanager
def _client(cluster: str, stop: Callable[[], bool]) -> Iterator[Any]:
    """A client of the cluster; None if asked to stop before there is one.

    Connecting and closing may take Dask long and cannot be interrupted. After a request to stop,
    what takes too long is left to the end of this process.
    """
    connected: Future[tuple[Any, ExitStack]] = Future()
    resource_tracker.ensure_running()  # if Dask starts it, signals are unblocked
    threading.Thread(target=_connect, args=(cluster, connected), daemon=True).start()
    deadline = time.monotonic() + _GREETING_SECONDS
    while not connected.done():
        if stop():
            yield None
            return
        if time.monotonic() > deadline:
            raise UserError(f"--dask {cluster}: no answer within {_GREETING_SECONDS:g} s")
        futures_wait([connected], timeout=TICK)
    client, stack = connected.result()
    try:
        yield client
    finally:
        closing = threading.Thread(target=stack.close, daemon=True)
        closing.start()
        closing.join(_STOP_SECONDS if stop() else None)


def _connect(cluster: str, connected: "Future[tuple[Any, ExitStack]]") -> None:
    """Set a future's result to a client and what closes it, or to the error."""
    # Ctrl-C at a terminal reaches all processes, but only the driver must act on it. The processes
    # that Dask starts inherit the blocked signal.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    from distributed import Client  # an optional dependency, and slow to import

    # Dask's messages about workers that come and go would disturb the progress bar.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    kind, _, rest = cluster.partition(":")
    with ExitStack() as stack:
        address: Any = cluster
        try:
            if kind == "local":
                address = _local_cluster(int(rest))
                stack.callback(address.close)
            client = Client(address, timeout=_CONNECT_SECONDS, set_as_default=False)
            stack.callback(client.close)
        except Exception as error:
            message = " ".join(f"{type(error).__name__}: {error}".split())
            connected.set_exception(UserError(f"--dask {cluster}: cannot connect ({message})"))
        else:
            connected.set_result((client, stack.pop_all()))


def _local_cluster(workers: int) -> Any:
    """A cluster on this machine; tried again if one of its processes dies as it starts."""
    from distributed import LocalCluster

    for left in reversed(range(_STARTS)):
        try:
            return LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                dashboard_address=None,
                silence_logs=logging.CRITICAL,
            )
        except RuntimeError:
            if not left:
                raise
    raise AssertionError
