"""A process that forks others, as importing what they need takes a second.

It has no thread and no work: it imports modules of this package, forks, and tells how forks have
ended. It knows nothing that foreign code must not: it has no other variables than foreign code, and
a fork of trusted code reads its own from a file. The first nursery of a process is a new
interpreter. A fork that will have children gets a nursery of its own at its birth, before it knows
any work, so that it cannot pass on what it is told.
"""

import atexit
import gc
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import traceback
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import IO, Any

from olne_bench.bench.process import fork_loop, inside
from olne_bench.bench.process.arithmetic import same_arithmetic
from olne_bench.bench.process.family import (
    ends_within,
    has_ended,
    kill_descendants,
    kill_family,
)
from olne_bench.bench.process.fork_loop import receive, send
from olne_bench.bench.process.messages import StartError

#: How long a nursery may take to wait for a fork that was killed [s].
_ANSWER_SECONDS = 60.0
#: How long a nursery may take to end [s].
_END_SECONDS = 2.0
#: Descriptor of the standard error.
_ERRORS = 2
#: Signals that end a process; pygame, which HighwayEnv imports, would end it by another one.
_FATAL = (signal.SIGILL, signal.SIGFPE, signal.SIGBUS, signal.SIGSEGV)
#: What HighwayEnv imports for plots, which takes half a second and no process here needs.
_LATE = "matplotlib.pyplot"
#: Variables that a process of foreign code receives, by name and by the beginning of a name.
_VARIABLES = ("PATH", "LANG", "LANGUAGE", "TZ", "CC", "LD_LIBRARY_PATH", "VIRTUAL_ENV")
_FAMILIES = (
    *("LC_", "PYTHON", "OLNE_BENCH_", "OMP_", "OPENBLAS_", "MKL_", "VECLIB_", "NPY_", "NUMEXPR_"),
    *("NUMBA_", "JAX_", "XLA_", "TORCH_", "CUDA_", "MPL"),
)


@dataclass(frozen=True)
class Birth:
    """A process to be forked; its connection, its log and its variables are passed beside this.

    Attributes:
        path: its ``sys.path``.
        folder: its working folder.
        modules: what its nursery imports first.
        serves_forks: whether it is the fork server of foreign code.
        memory: limit [bytes] of the data of any other, None for no limit.
        has_children: whether such a one starts processes itself.
    """

    path: Sequence[str]
    folder: str
    modules: Sequence[str]
    serves_forks: bool = False
    memory: int | None = None
    has_children: bool = False


class Born:
    """A process that a nursery has forked."""

    def __init__(
        self,
        birth: Birth,
        connection: socket.socket,
        output: IO[Any],
        variables: Mapping[str, str],
        seconds: float,
    ) -> None:
        """Have it forked.

        Args:
            birth: what is wanted.
            connection: its end of the connection to this process.
            output: where it prints.
            variables: of its environment.
            seconds: time that this may take [s].

        Raises:
            StartError: if it takes longer.
        """
        self._nursery = _nursery(output)
        with tempfile.TemporaryFile() as file:
            file.write(json.dumps(dict(variables)).encode())
            file.seek(0)
            passed = connection.fileno(), output.fileno(), file.fileno()
            self._pid = self._nursery.ask({"fork": asdict(birth)}, passed, seconds)
        self._code = self._nursery.end() if self._pid is None else None

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
        if not ends_within(self.ended, seconds):
            return None
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


class Nursery:
    """A nursery, as the process that has it sees it.

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
        self._has_forked = False

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
            self._has_forked = True
            try:
                send(self._control, message, descriptors)
                return int(receive(self._control, seconds)[0]["said"])
            except TimeoutError as error:
                self.end()
                raise StartError(f"a process did not start within {seconds:g} s") from error
            except OSError:
                self.gone = True
                return None

    def tell(self, message: dict[str, Any]) -> None:
        """Say what it does not answer."""
        with self._lock, suppress(OSError):  # the next question finds out that it is gone
            send(self._control, message)

    def end(self) -> int:
        """End it and its forks; its exit code."""
        self.gone = True
        self._control.close()
        if self._process is None:
            return -int(signal.SIGKILL)
        if not self._has_forked:
            self._process.kill()  # it may be importing, and has nobody to end
        try:
            return self._process.wait(_END_SECONDS)
        except subprocess.TimeoutExpired:
            kill_family(self._process.pid)
            return self._process.wait()


_own: Nursery | None = None
_lock = threading.Lock()


def begin(modules: Sequence[str]) -> None:
    """Start the nursery of this process, which imports modules meanwhile, unless there is one."""
    _nursery(_ERRORS, modules)


def has_begun() -> bool:
    """Whether this process has a nursery."""
    return _own is not None and not _own.gone and _own.owner == os.getpid()


def meanwhile(modules: Sequence[str]) -> None:
    """Have the nursery that was begun import more, without waiting for it."""
    with _lock:
        if _own is not None and has_begun():
            _own.tell({"import": modules})


def _nursery(output: IO[Any] | int, modules: Sequence[str] = ()) -> Nursery:
    """The nursery of this process; if there is none, one is started, which imports modules."""
    global _own
    with _lock:
        if _own is None or not has_begun():
            _own = _interpreter(output, modules)
        return _own


def _interpreter(output: IO[Any] | int, modules: Sequence[str]) -> Nursery:
    """A nursery in a new interpreter; ``output`` is where it says what goes wrong."""
    ours, theirs = socket.socketpair()
    boot = f"import sys; sys.path[:] = {search_path()!r}; "
    boot += (
        f"from olne_bench.bench.process.nursery import serve; serve({theirs.fileno()}, {modules!r})"
    )
    with theirs:
        process = subprocess.Popen(
            [sys.executable, "-u", "-c", boot],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            env=foreign_variables(),
            pass_fds=[theirs.fileno()],
            start_new_session=True,  # it gets no Ctrl-C from the terminal
        )
    found = Nursery(ours, process)
    atexit.register(found.end)
    return found


def search_path() -> list[str]:
    """``sys.path`` for a process in another folder."""
    return [str(Path(entry).resolve()) if entry in ("", ".") else entry for entry in sys.path]


def foreign_variables() -> dict[str, str]:
    """Variables of a process of foreign code: none that tell what it is used for."""
    known = {name: os.environ[name] for name in os.environ if _is_told(name)}
    return known | dict(same_arithmetic())


def _is_told(name: str) -> bool:
    return name in _VARIABLES or name.startswith(_FAMILIES)


def serve(descriptor: int, modules: Sequence[str]) -> None:
    """Import modules, and fork for the parent process until it closes the connection."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the driver
    # Arrow's own pool takes a gibibyte of address space, which counts against memory limits.
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
    _import_at_first_use(_LATE)
    _import(modules)
    _serve(socket.socket(fileno=descriptor))


def _serve(control: socket.socket) -> None:
    with suppress(OSError):
        while True:
            asked, descriptors = receive(control, None)
            if "import" in asked:
                _import(asked["import"])
                continue
            if "end" in asked:
                said = _end_of(asked["end"])
            else:
                said = _fork(control, Birth(**asked["fork"]), *descriptors)
            send(control, {"said": said})
    kill_descendants(os.getpid())
    os._exit(0)


def _end_of(pid: int) -> int:
    """Exit code of a fork that has ended, negative for a signal."""
    try:
        return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    except ChildProcessError:
        return -int(signal.SIGKILL)


def _fork(control: socket.socket, birth: Birth, connection: int, output: int, file: int) -> int:
    """Fork a process that serves this one's parent; returns its process id."""
    _import(birth.modules)
    gc.freeze()  # a fork's collections leave its pages alone
    own = os.getpid()
    if pid := os.fork():
        for descriptor in (connection, output, file):
            os.close(descriptor)
        return pid
    code = 1
    try:
        control.close()
        os.setsid()
        for number in _FATAL:
            signal.signal(number, signal.SIG_DFL)
        for descriptor in (1, 2):
            os.dup2(output, descriptor)
        os.close(output)
        if birth.has_children:
            _have_nursery(connection, file)
        _move_in(birth, file)
        if birth.serves_forks:
            fork_loop.serve(connection)
        else:
            inside.serve(connection, own, birth.memory)
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(code)


def _import(modules: Sequence[str]) -> None:
    gc.disable()  # a third of the time of imports goes into looking for garbage
    for name in modules:
        with suppress(Exception):  # whoever needs it will say so
            import_module(name)
    gc.enable()


def _import_at_first_use(name: str) -> None:
    """Let a module, no package, be imported once something asks for what is in it."""
    late, spec = ModuleType(name), find_spec(name)
    # Others look there for whether it is installed, and where.
    late.__spec__, late.__file__ = spec, spec.origin if spec else None
    sys.modules[name] = late

    def asked(attribute: str) -> Any:
        if sys.modules.get(name) is late:
            del sys.modules[name]
        found = import_module(name)
        vars(late).update(vars(found))  # for those who have imported it
        return getattr(found, attribute)

    vars(late)["__getattr__"] = asked


def _have_nursery(*private: int) -> None:
    """Fork a nursery for this process, without descriptors that are this one's alone."""
    global _own
    ours, theirs = socket.socketpair()
    if os.fork() == 0:
        for descriptor in private:
            os.close(descriptor)
        ours.close()
        _serve(theirs)
    theirs.close()
    _own = Nursery(ours)


def _move_in(birth: Birth, file: int) -> None:
    """Take the folder, the search path and the variables that were passed."""
    with open(file, "rb") as variables:
        for name in filter(_is_told, [*os.environ]):  # what imports have set stays
            del os.environ[name]
        os.environ.update(json.loads(variables.read()))
    sys.path[:] = birth.path
    tempfile.tempdir = None
    with suppress(OSError):  # it may be gone
        os.chdir(birth.folder)
