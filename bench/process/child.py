"""A child process as its parent sees it: start it, give it work, watch, kill and replace it.

No process pool of a library has all that is needed here: a time limit for every piece of work on a
monotonic clock, answers that execute nothing, an exit with code 0 that is noticed, and descendants
that die with their process. Each child has its own socket and session, so children share nothing.
"""

import math
import os
import pickle
import secrets
import signal
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from olne_bench.bench.process.channel import Channel, ClosedError, GarbageError
from olne_bench.bench.process.family import has_descendants, held_memory
from olne_bench.bench.process.fork_server import Forked, ForkServer, ServerGoneError
from olne_bench.bench.process.messages import (
    Message,
    Raised,
    Ready,
    Stage,
    StartError,
    decode_message,
    decode_value,
)
from olne_bench.bench.process.reachable import reachable
from olne_bench.bench.process.started import Started
from olne_bench.bench.text import clip
from olne_bench.errors import UserError

#: How often work is tried if something else may have killed its process.
ATTEMPTS = 3
#: Time [s] in which a process has to import everything, even from a slow network file system.
START_LIMIT = 300.0
#: How long a process may still run after its connection is closed [s].
_DEATH_SECONDS = 5.0
#: How often a waiting caller checks its process [s].
TICK = 0.2
#: How long a process may take to read its next work [s].
_SEND_SECONDS = 10.0
#: How often a waiting caller counts the memory of a process and its descendants [s]. It takes
#: milliseconds.
_MEMORY_SECONDS = 0.3

_KILLED_FROM_OUTSIDE = {-signal.SIGKILL, -signal.SIGTERM}


class ChildError(Exception):
    """A piece of work without a result. The process is gone."""


class TimedOutError(ChildError):
    """It took too long."""


class OutOfMemoryError(ChildError):
    """It took too much memory."""


class MisspokeError(ChildError):
    """The answer is malformed, or was not asked for."""


class LeftProcessesError(ChildError):
    """It left processes running."""


class DiedError(ChildError):
    """The process died.

    Attributes:
        outside: whether another process may have killed it.
        served: number of pieces of work that it had done before, which may have damaged it.
    """

    def __init__(self, cause: str, *, outside: bool, served: int) -> None:
        super().__init__(cause)
        self.outside, self.served = outside, served


class RaisedError(Exception):
    """The work raised an exception; the process lives on."""


class Child:
    """One process, started with its first work and again after it has died.

    Attributes:
        busy: whether it is working.
        served: number of pieces of work that the present process has done.
        stage: last stage of the work that was announced; empty before the first.
        modules: names of modules of this package that its next process has imported, if any.
    """

    def __init__(
        self,
        *,
        log: Path | None = None,
        memory: int | None = None,
        restricted: bool = False,
        plugins: Sequence[str] = (),
        hidden: Path | None = None,
        readable: Sequence[Path] = (),
        may_announce: bool = False,
        has_children: bool = False,
    ) -> None:
        """Set limits; nothing is started yet.

        Args:
            log: file for what the process prints. Default: this process's standard error.
            memory: limit [bytes] of the process with its descendants, None for no limit.
            restricted: whether it runs foreign code; it is then the fork of a fork server, in a
                sandbox (``process.sandbox``) and in an empty folder.
            plugins: references of the plugins that a restricted process runs.
            hidden: folder that a restricted process cannot read.
            readable: further files that it can read.
            may_announce: whether it may divide its work into stages with their own time limits.
            has_children: whether it is a parent of ``Child`` itself: then processes may be left
                when its work is done, and only its own memory is limited here.
        """
        self.busy = False
        self.served = 0
        self._log, self._memory = log, memory
        self._restricted, self._hidden, self._may_announce = restricted, hidden, may_announce
        self._plugins, self._readable = plugins, readable
        self.modules: Sequence[str] = ()
        self._has_children = has_children
        self._process: Started | Forked | None = None
        self._server: ForkServer | None = None
        self._ready = False
        self._token = 0
        self.stage = ""
        self._limit = self._deadline = self._next_look = 0.0

    @property
    def channel(self) -> Channel:
        """The connection; it is readable when ``poll`` may find something."""
        assert self._process is not None
        return self._process.channel

    def submit(
        self,
        function: Callable[..., Any],
        *arguments: Any,
        seconds: float,
        longest: float = math.inf,
        stage: str = "",
    ) -> None:
        """Give an idle process its next work.

        Args:
            function: the work, a function at the top level of a module.
            arguments: its arguments, which can be pickled.
            seconds: time that it may take once the process has started [s].
            longest: time that all stages may take together [s], whatever is announced.
            stage: name of its first stage.
        """
        assert not self.busy
        if self._process is not None and not self.channel.is_quiet():
            self.end()  # it has sent something without being asked
        if self._process is None:
            self._process = self._started()
        self.busy = True
        self._token = secrets.randbits(62)
        self._limit, self.stage = seconds, stage
        self._end = time.monotonic() + START_LIMIT + longest
        now = time.monotonic()
        self._deadline = now + (seconds if self._ready else START_LIMIT)
        self._next_look = now + _MEMORY_SECONDS
        if self.served and self._alone:
            self._signal(signal.SIGCONT)
        with suppress(ClosedError):  # it is dead already, which ``poll`` will find
            self.channel.send(pickle.dumps((self._token, function, arguments)), _SEND_SECONDS)

    def poll(self, kind: Any) -> Any:
        """The result of the work; None while it runs. Never waits.

        Args:
            kind: type of the result, for ``messages.decode_value``; it must not be None.

        Raises:
            ChildError: if there is no result.
            RaisedError: if the work raised an exception.
            UserError: if the work raised one about bad input.
        """
        assert self.busy and self._process is not None
        try:
            return self._poll(kind)
        except ServerGoneError as error:
            served = self.served
            self.stop()
            raise DiedError("the process was killed", outside=True, served=served) from error

    def _poll(self, kind: Any) -> Any:
        assert self._process is not None
        result = self._read(kind)
        if result is None and self._process.ended():
            result = self._read(kind)  # what it said between the last look and its end
            if result is None:
                raise self._death("")
        if result is None:
            self._look_after()
        return result

    def _read(self, kind: Any) -> Any:
        """The result, if it is among what has arrived; None if not."""
        try:
            while (frame := self.channel.poll()) is not None:
                message = decode_message(frame)
                if isinstance(message, Ready) and not self._ready:
                    self._ready = True
                    self._deadline = time.monotonic() + self._limit
                elif isinstance(message, Stage) and self._may_announce:
                    self.stage = message.name
                    left = self._end - time.monotonic()
                    self._limit = message.seconds if message.seconds <= left else max(0.0, left)
                    self._deadline = time.monotonic() + self._limit
                else:
                    return self._take(message, kind)
        except ClosedError as error:
            raise self._death(str(error)) from error
        except (GarbageError, ValueError) as error:
            self.end()
            raise MisspokeError(clip(str(error))) from error
        return None

    def wait(self, kind: Any) -> Any:
        """Wait for the result of the work; raises as ``poll``."""
        while (result := self.poll(kind)) is None:
            self.channel.wait(TICK)
        return result

    def call(self, function: Callable[..., Any], *arguments: Any, kind: Any, seconds: float) -> Any:
        """``submit`` and ``wait``."""
        self.submit(function, *arguments, seconds=seconds)
        return self.wait(kind)

    def load(self, libraries: Sequence[str]) -> None:
        """Have a restricted process's fork server import libraries, so that forks need not.

        Args:
            libraries: names of modules. Those that cannot be imported are left out, and all of
                them where the server would not survive it.
        """
        self.end()
        if self._server is not None and libraries:
            try:
                self._server.load(libraries)
            except ServerGoneError:
                self._server = None

    def end(self) -> None:
        """Kill the process and all its descendants; a fork server stays ready for the next."""
        if self._process is not None:
            self._process.stop()
        self._process = None
        self.busy = self._ready = False
        self.served = 0

    def renew(self) -> None:
        """End a restricted process. Its fork server has the next one ready before it is needed."""
        self.end()
        if self._server is not None:
            self._process = self._started()

    def stop(self) -> None:
        """Kill the process and all its descendants, its fork server included."""
        self.end()
        if self._server is not None:
            self._server.stop()
        self._server = None

    def _started(self) -> Started | Forked:
        self._ready, self.served = False, 0
        if not self._restricted:
            given = self._log, self._memory, self.modules, self._has_children
            return Started(*given, seconds=START_LIMIT)
        if self._server is None or self._server.ended():
            reach = reachable(self._plugins, self._hidden)
            reach = replace(reach, readable=(*reach.readable, *self._readable))
            self._server = ForkServer(reach, self.modules, self._log)
        return self._server.fork(memory=self._memory, has_children=self._has_children)

    def _take(self, message: Message, kind: Any) -> Any:
        if isinstance(message, Ready | Stage) or message.token != self._token:
            self.end()
            raise MisspokeError("sent an unexpected message")
        self.busy = False
        self.served += 1
        assert self._process is not None
        if self._alone:
            self._signal(signal.SIGSTOP)  # none of its threads works while nobody counts the time
        left = self._alone and has_descendants(self._process.pid)
        if isinstance(message, Raised):
            self._retire(left or message.kind == "memory")
            return _raise(message, self._memory)
        try:
            value = decode_value(message.value, kind)
        except ValueError as error:
            self.end()
            raise MisspokeError(clip(str(error))) from error
        self._retire(left or message.retire)
        if left:
            raise LeftProcessesError("left processes running: what it starts has to end with it")
        return value

    @property
    def _alone(self) -> bool:
        """Whether it may have no other process when its work is done."""
        return self._restricted and not self._has_children

    def _signal(self, number: signal.Signals) -> None:
        assert self._process is not None
        with suppress(ProcessLookupError):
            os.kill(self._process.pid, number)

    def _retire(self, unfit: bool) -> None:
        if unfit:
            self.end()

    def _look_after(self) -> None:
        """End the work if it takes too much time or memory."""
        now = time.monotonic()
        if now > self._deadline:
            started, stage = self._ready, f" of {self.stage}" if self.stage else ""
            self.end() if started else self.stop()
            if not started:
                raise StartError(f"a process did not start within {START_LIMIT:g} s")
            raise TimedOutError(f"killed after {self._limit:g} s{stage}")
        if self._memory is not None and self._restricted and now > self._next_look:
            self._next_look = now + _MEMORY_SECONDS
            assert self._process is not None
            held = held_memory(self._process.pid, descendants=not self._has_children)
            if held > self._memory:
                self.end()
                raise OutOfMemoryError(_too_much(self._memory, f"{held / 2**30:.3g} GiB are held"))

    def _death(self, last_words: str) -> DiedError:
        assert self._process is not None
        started, served = self._ready, self.served
        code = self._process.exit_code(_DEATH_SECONDS)
        cause = last_words if code is None else _cause(code)
        self.end()
        if not started:
            self.stop()
            cause = f"a process {cause} before it had started"
            return DiedError(cause, outside=True, served=served)
        outside = code in _KILLED_FROM_OUTSIDE
        return DiedError(f"the process {cause}", outside=outside, served=served)


def _raise(message: Raised, memory: int | None) -> Any:
    if message.kind == "user":
        raise UserError(clip(message.message))
    if message.kind == "memory" and memory is not None:
        raise OutOfMemoryError(_too_much(memory, clip(message.message)))
    raise RaisedError(clip(message.message))


def _too_much(memory: int, detail: str) -> str:
    return f"out of memory, the limit is {memory / 2**30:.3g} GiB: {detail}"


def _cause(code: int) -> str:
    if code >= 0:
        return f"died with exit code {code}"
    try:
        return f"was killed by {signal.Signals(-code).name} (signal {-code})"
    except ValueError:
        return f"was killed by signal {-code}"
