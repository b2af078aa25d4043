"""A fork server and its forks, as the process that has them sees them (``fork_loop``)."""

import os
import select
import shutil
import signal
import socket
import sys
import tempfile
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from olne_bench.bench.process import fork_loop
from olne_bench.bench.process.channel import Channel
from olne_bench.bench.process.family import ends_within, has_ended, kill_family
from olne_bench.bench.process.fork_loop import Order, as_request
from olne_bench.bench.process.messages import StartError
from olne_bench.bench.process.nursery import Birth, Born, foreign_variables, search_path
from olne_bench.bench.process.reachable import Reach
from olne_bench.bench.process.sandbox import scopes_signals
from olne_bench.games.compiled.compiler import reader_environment
from olne_bench.visible import visible

#: How long a server may take to start [s].
_START_SECONDS = 300.0
#: How long a server may take for an answer once it has started [s].
_ANSWER_SECONDS = 60.0
#: How long a server may take to end its forks and itself [s].
_END_SECONDS = 2.0
#: Most of what one process prints that a log keeps [bytes].
_MOST_LOG = 2**20


class ServerGoneError(Exception):
    """The server does not answer; it has been ended with all its forks."""


class Forked:
    """A process that a server has forked.

    Attributes:
        channel: the connection to it.
    """

    def __init__(self, server: "ForkServer", channel: Channel, folder: Path, log: BinaryIO) -> None:
        self.channel = channel
        self._server, self._folder, self._log = server, folder, log
        self._pid: int | None = None
        self._stopped = False

    @property
    def pid(self) -> int:
        """Its process id.

        Raises:
            ServerGoneError: if the server did not fork it.
        """
        if self._pid is None:
            self._pid = self._server.answer("pid", _ANSWER_SECONDS)
        return self._pid

    def ended(self) -> bool:
        """Whether it has ended, or was never forked."""
        if self._pid is None and not self._server.has_answered():
            return self._server.ended()
        try:
            return has_ended(self.pid)
        except ServerGoneError:
            return True

    def exit_code(self, seconds: float) -> int | None:
        """Its exit code, negative for a signal; None if it is still running after ``seconds``."""
        if not ends_within(self.ended, seconds):
            return None
        self.stop()
        with suppress(ServerGoneError):
            return self._server.answer("code", _ANSWER_SECONDS)
        return self._server.exit_code

    def stop(self) -> None:
        """End it with all its descendants. The server forks no other before it is gone."""
        if self._stopped:
            return
        self._stopped = True
        with suppress(ServerGoneError):
            if scopes_signals():  # the server ends its descendants, and can do so at once
                with suppress(ProcessLookupError):
                    os.kill(self.pid, signal.SIGKILL)
            else:
                kill_family(self.pid)
            self._server.end(self)
        self.channel.close()

    def clear(self) -> bytes:
        """Remove its folder; returns what it has printed, cut to ``_MOST_LOG``."""
        said = b""
        with suppress(OSError):
            self._log.seek(0)
            said = self._log.read(_MOST_LOG)
            rest = os.fstat(self._log.fileno()).st_size - len(said)
            said += f"\n[{rest} more bytes]\n".encode() if rest > 0 else b""
        self._log.close()
        shutil.rmtree(self._folder, ignore_errors=True)
        self._folder.with_suffix(".log").unlink(missing_ok=True)
        return said


class ForkServer:
    """A restricted process that forks.

    Attributes:
        exit_code: exit code of the server's process after it has gone.
    """

    def __init__(self, reach: Reach, modules: Sequence[str], log: Path | None) -> None:
        """Start it.

        Args:
            reach: what forks may read and run.
            modules: modules that it imports before the first fork.
            log: file for what forks print. Default: this process's standard error.
        """
        self._log = log
        self._home = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        #: Kinds of answers to come, and the process that is gone with one.
        self._waiting: deque[tuple[str, Forked | None]] = deque()
        ours, theirs = socket.socketpair()
        home = Path(self._home.name)
        variables = foreign_variables() | reader_environment(home / "cache")
        birth = Birth(search_path(), self._home.name, modules, serves_forks=True)
        with theirs, Path(os.devnull).open("ab") as output:
            given = birth, theirs, output, variables | {"TMPDIR": str(home)}
            try:
                self._process = Born(*given, seconds=_START_SECONDS)
            except StartError:
                ours.close()
                raise
        self._control = ours
        self._forks: list[Forked] = []
        self.exit_code = 0
        self._ask(
            "shared",
            {
                "readable": [str(place) for place in reach.readable],
                "listable": [str(place) for place in reach.listable],
                "folder": self._home.name,
            },
        )

    def fork(self, *, memory: int | None, has_children: bool) -> Forked:
        """Ask for a process; whether there is one is seen when it answers.

        Args:
            memory: limit [bytes] of its data, None for no limit.
            has_children: whether it starts fork servers itself.
        """
        folder = Path(tempfile.mkdtemp(dir=self._home.name))  # its name tells no number of trials
        ours, theirs = socket.socketpair()
        log = folder.with_suffix(".log").open("w+b", buffering=0)
        order = Order(str(folder), memory, has_children)
        with theirs:
            self._ask("pid", as_request(order), (theirs.fileno(), log.fileno()))
        forked = Forked(self, Channel(ours), folder, log)
        self._forks.append(forked)
        return forked

    def load(self, names: Sequence[str]) -> None:
        """Import libraries, so that forks need not.

        Raises:
            ServerGoneError: if the server did not survive this, or cannot be forked any more.
        """
        self._ask("shared", {"import": list(names)})
        if self.answer("shared", _ANSWER_SECONDS) > 0:
            self.stop()
            raise ServerGoneError("a library has started threads or opened files")

    def answer(self, kind: str, seconds: float) -> int:
        """The next answer of a kind; those before it are read as well.

        Raises:
            ServerGoneError: if there is none within ``seconds``.
            StartError: if the server cannot be restricted.
        """
        while self._waiting:
            expected, ended = self._waiting.popleft()
            try:
                found, _ = fork_loop.receive(self._control, seconds)
                if "refused" in found:
                    self._abandon()
                    raise StartError(f"foreign code cannot be restricted: {found['refused']}")
                value = int(found[expected])
            except (OSError, ValueError, KeyError) as error:
                self._waiting.appendleft((expected, ended))
                self._abandon()
                raise ServerGoneError("the fork server is gone") from error
            if ended is not None:
                self._forks.remove(ended)
                self._keep(ended.clear())
            if expected == kind:
                return value
        raise ServerGoneError("the fork server is gone")

    def has_answered(self) -> bool:
        """Whether there is an answer to read."""
        if self._control.fileno() < 0:
            return False
        poll = select.poll()
        poll.register(self._control, select.POLLIN)
        return bool(poll.poll(0))

    def ended(self) -> bool:
        """Whether the server's process has ended."""
        return self._process.ended()

    def end(self, forked: Forked) -> None:
        """Have the server wait for a process that was killed, and end what it has left."""
        self._ask("code", {"end": forked.pid}, ended=forked)

    def stop(self) -> None:
        """End the server and all its forks."""
        with suppress(ServerGoneError):
            while any(ended for _, ended in self._waiting):
                self.answer("code", _ANSWER_SECONDS)
        self._abandon()

    def _abandon(self) -> None:
        """End the server and all its forks without waiting for answers."""
        if self._control.fileno() < 0:
            return
        killed = not self.ended()
        self._control.close()
        code = self._process.exit_code(_END_SECONDS)  # it ends with its forks
        self._process.stop()
        self.exit_code = -signal.SIGKILL if killed or code is None else code
        for forked in self._forks:
            self._keep(forked.clear())
        self._forks.clear()
        self._waiting.clear()
        self._home.cleanup()

    def _ask(
        self,
        kind: str,
        message: dict[str, object],
        descriptors: tuple[int, ...] = (),
        ended: Forked | None = None,
    ) -> None:
        with suppress(OSError):  # it is dead, which the answer will show
            fork_loop.send(self._control, message, descriptors)
        self._waiting.append((kind, ended))

    def _keep(self, said: bytes) -> None:
        if not said:
            return
        if self._log is None:
            for line in said.decode(errors="replace").splitlines():
                sys.stderr.write(f"a plugin says: {visible(line)}\n")
        else:
            with self._log.open("ab") as file:
                file.write(said)
