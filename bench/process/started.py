"""Processes of trusted code: forks of one that has imported it, as importing takes a second.

Such a nursery has no thread and no work: it imports modules, forks, and tells how forks have ended.
The first one of a process is a new interpreter. A fork that will have children gets a nursery of
its own at its birth, before it knows any work, so that it cannot pass on what it is told.
"""

import atexit
import gc
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from olne_bench.bench.process import inside
from olne_bench.bench.process.arithmetic import same_arithmetic
from olne_bench.bench.process.channel import Channel
from olne_bench.bench.process.family import has_ended, kill_descendants, kill_family
from olne_bench.bench.process.fork_loop import receive, send
from olne_bench.bench.process.fork_server import search_path
from olne_bench.bench.process.messages import StartError

#: How long a nursery may take to wait for a fork that was killed [s].
_ANSWER_SECONDS = 60.0
#: How long a nursery may take to end [s].
_END_SECONDS = 2.0
#: How often a process is looked at while its end is waited for [s].
_LOOK_SECONDS = 0.005


@dataclass(frozen=True)
class Order:
    """A process to be forked. Its connection and its log are passed beside this.

    Attributes:
        environment: its variables.
        path: its ``sys.path``.
        folder: its working folder.
        memory: limit [bytes] of its data, None for no limit.
        modules: what its nursery imports first.
        has_children: whether it starts processes itself.
    """

    environment: Mapping[str, str]
    path: Sequence[str]
    folder: str
    memory: int | None
    modules: Sequence[str]
    has_children: bool


class Started:
    """A process with this process's rights, in the same folder.

    Attributes:
        channel: the connection to it.
    """

    def __init__(
        self,
        log: Path | None,
        memory: int | None,
        modules: Sequence[str],
        has_children: bool,
        seconds: float,
    ) -> None:
        """Start it.

        Args:
            log: file for what it prints. Default: this process's standard error.
            memory: limit [bytes] of its data, None for no limit.
            modules: what it needs to import.
            has_children: whether it starts processes itself.
            seconds: time that it may take [s].

        Raises:
            StartError: if it takes longer.
        """
        ours, theirs = socket.socketpair()
        variables = dict(os.environ | same_arithmetic())
        order = Order(variables, search_path(), _folder(), memory, modules, has_children)
        with theirs, ExitStack() as stack:
            place = Path(os.devnull) if log is None and sys.__stderr__ is None else log
            output: Any = stack.enter_context(place.open("ab")) if place else sys.__stderr__
            self._nursery = _nursery(output)
            passed = theirs.fileno(), output.fileno()
            try:
                self._pid = self._nursery.ask({"fork": asdict(order)}, passed, seconds)
            except StartError:
                ours.close()
                raise
        self.channel = Channel(ours)
        self._code = self._nursery.exit_code() if self._pid is None else None

    @property
    def pid(self) -> int:
        """Its process id."""
        assert self._pid is not None
        return self._pid

    def ended(self) -> bool:
        """Whether it has ended."""
        return self._code is not None or self._nursery.gone or has_ended(self.pid)

    def exit_code(self, seconds: float) -> int | None:
        """Its exit code, negative for a signal; None if it is still running after ``seconds``."""
        deadline = time.monotonic() + seconds
        while not self.ended():
            if time.monotonic() > deadline:
                return None
            time.sleep(_LOOK_SECONDS)
        if self._code is None:
            code = self._nursery.ask({"end": self.pid})
            self._code = -int(signal.SIGKILL) if code is None else code
        return self._code

    def stop(self) -> None:
        """End it with all its descendants."""
        # Until its nursery has waited for it, no other process has its id.
        if self._code is None and not self._nursery.gone:
            kill_family(self.pid)
            self.exit_code(_ANSWER_SECONDS)
        self.channel.close()


class Nursery:
    """A process that forks, as the process that has it sees it.

    Attributes:
        owner: process id of that one.
        gone: whether it does not answer any more; its forks end with it.
    """

    def __init__(
        self, control: socket.socket, process: "subprocess.Popen[bytes] | None" = None
    ) -> None:
        """Take over the connection to a nursery, and its process if it is no fork."""
        self.owner, self.gone = os.getpid(), False
        self._control, self._process = control, process
        self._lock = threading.Lock()

    def ask(
        self,
        message: dict[str, Any],
        descriptors: tuple[int, ...] = (),
        seconds: float = _ANSWER_SECONDS,
    ) -> int | None:
        """Its answer; None if it is gone.

        Raises:
            StartError: if there is none in time. Then it is ended.
        """
        with self._lock:
            try:
                send(self._control, message, descriptors)
                return int(receive(self._control, seconds)[0]["said"])
            except TimeoutError as error:
                self.exit_code()
                raise StartError(f"a process did not start within {seconds:g} s") from error
            except OSError:
                self.gone = True
                return None

    def exit_code(self) -> int:
        """End it; its exit code."""
        self.gone = True
        self._control.close()
        if self._process is None:
            return -int(signal.SIGKILL)
        try:
            return self._process.wait(_END_SECONDS)  # it ends with its forks
        except subprocess.TimeoutExpired:
            kill_family(self._process.pid)
            return self._process.wait()


def _folder() -> str:
    try:
        return str(Path.cwd())
    except OSError:  # it is gone, and a fork stays where its nursery is
        return ""


_own: Nursery | None = None
_lock = threading.Lock()


def _nursery(output: Any) -> Nursery:
    """The nursery of this process, which is started if there is none."""
    global _own
    with _lock:
        if _own is None or _own.gone or _own.owner != os.getpid():
            _own = _interpreter(output)
        return _own


def _interpreter(output: Any) -> Nursery:
    """A nursery in a new interpreter; ``output`` is where it says what goes wrong."""
    ours, theirs = socket.socketpair()
    boot = f"import sys; sys.path[:] = {search_path()!r}; "
    boot += f"from olne_bench.bench.process.started import serve; serve({theirs.fileno()})"
    with theirs:
        process = subprocess.Popen(
            [sys.executable, "-u", "-c", boot],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            env=os.environ | same_arithmetic(),
            pass_fds=[theirs.fileno()],
            start_new_session=True,  # it gets no Ctrl-C from the terminal
        )
    found = Nursery(ours, process)
    atexit.register(found.exit_code)
    return found


def serve(descriptor: int) -> None:
    """Fork for the parent process until it closes the connection."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the driver
    _serve(socket.socket(fileno=descriptor))


def _serve(control: socket.socket) -> None:
    with suppress(OSError):
        while True:
            asked, descriptors = receive(control, None)
            if "end" in asked:
                said = _end_of(asked["end"])
            else:
                said = _fork(control, Order(**asked["fork"]), *descriptors)
            send(control, {"said": said})
    kill_descendants(os.getpid())
    os._exit(0)


def _end_of(pid: int) -> int:
    """Exit code of a fork that has ended, negative for a signal."""
    try:
        return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    except ChildProcessError:
        return -int(signal.SIGKILL)


def _fork(control: socket.socket, order: Order, connection: int, output: int) -> int:
    """Fork a process that serves this one's parent; returns its process id."""
    for name in order.modules:
        with suppress(Exception):  # whoever needs it will say so
            import_module(name)
    gc.freeze()  # a fork's collections leave its pages alone
    own = os.getpid()
    if pid := os.fork():
        os.close(connection)
        os.close(output)
        return pid
    code = 1
    try:
        control.close()
        _move_in(order, connection, output)
        inside.serve(connection, own, order.memory)
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(code)


def _move_in(order: Order, connection: int, output: int) -> None:
    """Make a fork a process of its own, with its own log, variables and nursery."""
    global _own
    os.setsid()
    for descriptor in (1, 2):
        os.dup2(output, descriptor)
    os.close(output)
    os.environ.clear()
    os.environ.update(order.environment)
    sys.path[:] = order.path
    with suppress(OSError):
        os.chdir(order.folder)
    if order.has_children:
        ours, theirs = socket.socketpair()
        if os.fork() == 0:
            os.close(connection)
            ours.close()
            _serve(theirs)
        theirs.close()
        _own = Nursery(ours)
