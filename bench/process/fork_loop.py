"""The loop of a fork server: a restricted process that forks others, which run foreign code.

The server is a fork that has imported modules of this package (``nursery``). It restricts itself
before anything else, imports libraries that it is told, and never foreign code. So each fork starts
from the same state, restricted from its first instruction, and no fork leaves anything for the
next: it has a folder of its own, and nothing else that it can write to.
"""

import gc
import importlib
import json
import os
import resource
import signal
import socket
import struct
import sysconfig
import tempfile
import traceback
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache, lru_cache
from importlib.metadata import distributions
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from olne_bench.bench.process import inside
from olne_bench.bench.process.family import (
    adopt_orphans,
    end_with_parent,
    has_descendants,
    kill_descendants,
    kill_sandbox,
)
from olne_bench.bench.process.sandbox import (
    allow_reading,
    enforce,
    restrict,
    rules_for,
    scopes_signals,
)
from olne_bench.errors import UserError
from olne_bench.games.compiled.compiler import backend

#: Folders of Python's modules and of installed ones, as ``sysconfig`` names them.
_LIBRARIES = ("stdlib", "platstdlib", "purelib", "platlib")
#: Groups of entry points that name plugins begin so.
_PLUGINS = "olne_bench."
_LENGTH = struct.Struct("!I")
#: Files of the whole machine in /proc that libraries read. A fork sees no other process there.
_MACHINE = ("cpuinfo", "meminfo", "stat", "uptime", "loadavg", "version", "filesystems", "sys")


@dataclass(frozen=True)
class Order:
    """A process to be forked. Its connection and its log are passed beside this.

    Attributes:
        folder: its working folder, the only one that it can write to.
        memory: limit [bytes] of its data and of each file, None for no limit.
        has_children: whether it starts fork servers itself, and so has to see their processes.
    """

    folder: str
    memory: int | None
    has_children: bool


def send(
    control: socket.socket, message: dict[str, Any], descriptors: tuple[int, ...] = ()
) -> None:
    """Send a message, and open files with it.

    Raises:
        OSError: if the other side is gone.
    """
    content = json.dumps(message).encode()
    control.settimeout(None)
    socket.send_fds(control, [_LENGTH.pack(len(content)) + content], descriptors)


def receive(control: socket.socket, seconds: float | None) -> tuple[dict[str, Any], list[int]]:
    """Receive a message, and the open files that come with it.

    Raises:
        OSError: if the other side is gone, or nothing comes in time.
    """
    control.settimeout(seconds)
    content, descriptors, _, _ = socket.recv_fds(control, _LENGTH.size, 3)
    while len(content) < _LENGTH.size:
        content += _some(control, _LENGTH.size - len(content))
    (length,) = _LENGTH.unpack(content)
    body = b""
    while len(body) < length:
        body += _some(control, length - len(body))
    found: dict[str, Any] = json.loads(body)
    return found, descriptors


def _some(control: socket.socket, most: int) -> bytes:
    if not (content := control.recv(most)):
        raise ConnectionError("the other side is gone")
    return content


def serve(descriptor: int) -> None:
    """Serve the parent process until it closes the connection."""
    control = socket.socket(fileno=descriptor)
    adopt_orphans()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the driver
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    parent, confined = os.getppid(), False
    with suppress(OSError):
        start, _ = receive(control, None)
        readable, listable = ([*map(Path, start[kind])] for kind in ("readable", "listable"))
        home = Path(start["folder"])
        top = _top([*readable, *listable, home])
        try:
            restrict(readable, listable, home)
        except OSError as error:
            send(control, {"refused": str(error)})
            return
        confined = scopes_signals() and not _can_signal(parent)
        own = _shared()
        gc.collect()
        gc.freeze()  # a fork's collections leave its pages alone
        with suppress(UserError):
            backend()  # it asks the compiler, which takes longer than a fork
        send(control, {"shared": _shared() - own})
        while True:
            _obey(control, top, confined, own)
    _end_forks(confined)
    os._exit(0)


def _obey(control: socket.socket, top: list[Path], confined: bool, own: int) -> None:
    """Do what the parent asks for next; ``own`` is ``_shared`` before libraries were imported."""
    asked, descriptors = receive(control, None)
    if "fork" in asked:
        order = Order(**asked["fork"])
        send(control, {"pid": _fork(control, top, order, *descriptors)})
    elif "end" in asked:
        send(control, {"code": _wait(asked["end"], confined)})
    else:
        _import(name for name in asked["import"] if _is_library(name))
        send(control, {"shared": _shared() - own})


def _import(names: Any) -> None:
    """Import modules; one that cannot be imported is left to the plugin that wants it."""
    for name in names:
        with suppress(BaseException):
            importlib.import_module(name)
    gc.collect()
    gc.freeze()  # a fork's collections leave its pages alone


def _is_library(name: str) -> bool:
    """Whether a module is Python's or an installed one, and no part of a plugin.

    It is not imported, and neither is what it belongs to. Its name is a plugin's word.
    """
    return _is_installed(name.partition(".")[0])


@cache
def _is_installed(top: str) -> bool:
    """As ``_is_library``, of a name at the top: hundreds of modules share a few."""
    with suppress(BaseException):
        spec = find_spec(top)
        origin = None if spec is None else spec.origin
        if origin in ("built-in", "frozen"):
            return True
        folders = {Path(sysconfig.get_path(kind)) for kind in _LIBRARIES}
        installed = origin is not None and any(f in Path(origin).parents for f in folders)
        return installed and top not in _installed_plugins()
    return False


@lru_cache(maxsize=1)
def _installed_plugins() -> frozenset[str]:
    """Names at the top of the distributions that have plugins, but for this package."""
    with_plugins = (
        one
        for one in distributions()
        if any(p.group.startswith(_PLUGINS) for p in one.entry_points)
    )
    files = (file for one in with_plugins for file in one.files or ())
    return frozenset(file.parts[0].removesuffix(".py") for file in files) - {"olne_bench"}


def _shared() -> int:
    """Number of threads and open files of this process.

    With several threads it cannot be forked safely. All forks have one place in an open file, and
    one set of its flags, which they would remember.
    """
    try:
        return sum(len(os.listdir(f"/proc/self/{kind}")) for kind in ("task", "fd"))  # noqa: PTH208
    except OSError:
        import threading

        return threading.active_count()


def _can_signal(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except PermissionError:
        return False
    return True


def _fork(control: socket.socket, top: list[Path], order: Order, connection: int, log: int) -> int:
    """Fork a process that serves its parent's parent; returns its process id here."""
    server = os.getpid()
    # Made here, where no memory has to be copied for it.
    rules = rules_for(_places(top, order), (), Path(order.folder))
    pid = os.fork()
    if pid:
        for descriptor in (connection, log, *([] if rules is None else [rules])):
            os.close(descriptor)
        return pid
    code = 1
    try:
        control.close()
        _move_in(server, order, log, rules)
        inside.serve_forked(connection, order.memory)
        code = 0
    except BaseException:  # a request names code that is not there
        traceback.print_exc()
    finally:
        os._exit(code)


def _move_in(server: int, order: Order, log: int, rules: int | None) -> None:
    """Make a fork a process of its own, with its own folder, limits and view of the machine."""
    os.setsid()
    adopt_orphans()
    end_with_parent(server)
    empty = os.open(os.devnull, os.O_RDWR)  # flags of the server's would be seen by the next fork
    for descriptor, file in ((0, empty), (1, log), (2, log)):
        os.dup2(file, descriptor)
    os.close(empty)
    os.close(log)
    os.umask(0o077)
    os.chdir(order.folder)
    tempfile.tempdir = None
    os.environ |= {"TMPDIR": order.folder, "HOME": order.folder, "PWD": order.folder}
    os.environ["OLNE_BENCH_CACHE"] = os.path.join(order.folder, "cache")  # noqa: PTH118
    if order.memory is not None:
        for limit in (resource.RLIMIT_DATA, resource.RLIMIT_FSIZE):
            resource.setrlimit(limit, (order.memory, order.memory))
    if rules is not None:
        allow_reading(rules, Path("/proc", str(os.getpid())))
        enforce(rules)


def _top(places: list[Path]) -> list[Path]:
    """The folders at the top of the machine that hold some places; a sandbox cannot list them."""
    return sorted({Path(*place.parts[:2]) for place in places})


def _places(top: list[Path], order: Order) -> list[Path]:
    """What a fork may read of what the server may: of /proc, nothing about other processes."""
    if order.has_children:
        return top
    rest = [place for place in top if place.name != "proc"]
    return [*rest, *(Path("/proc", name) for name in _MACHINE)]


def _wait(pid: int, confined: bool) -> int:
    """Exit code of a fork that was killed, negative for a signal. What it has left ends as well."""
    try:
        _, status = os.waitpid(pid, 0)
        code = os.waitstatus_to_exitcode(status)
    except ChildProcessError:
        code = -int(signal.SIGKILL)
    _end_forks(confined)
    return code


def _end_forks(confined: bool) -> None:
    """End all that forks have left; ``confined`` says that this process can signal no others."""
    if not has_descendants(os.getpid()):
        return
    if confined:
        kill_sandbox()
        return
    kill_descendants(os.getpid())
    with suppress(ChildProcessError):
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass


def as_request(order: Order) -> dict[str, Any]:
    """An order as a message."""
    return {"fork": asdict(order)}
