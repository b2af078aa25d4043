"""Estimators that try to leave the sandbox, and to remember one trial in the next.

Each says in its message where it has succeeded, as JSON.
"""

import builtins
import ctypes
import fcntl
import json
import mmap
import os
import resource
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import numpy as np

KEY = 0x0151
SECRET = b"weights"
_kept: dict[str, bytes] = {}
_mapped = b""
with suppress(OSError):
    _mapped = mmap.mmap(-1, 4096)  # shared with forks of the process that imports this
_libc = ctypes.CDLL(None, use_errno=True)
_libc.shmat.restype = ctypes.c_void_p


def _in_file(folder):
    path = Path(folder, "olne_bench_memory_of_a_plugin")

    def recall():
        return path.read_bytes()

    def keep():
        path.write_bytes(SECRET)

    return recall, keep


def _recall_segment():
    place = _libc.shmat(_libc.shmget(KEY, 4096, 0o600), None, 0)
    return ctypes.string_at(place, len(SECRET)) if place not in (None, 2**64 - 1) else b""


def _keep_segment():
    place = _libc.shmat(_libc.shmget(KEY, 4096, 0o1600), None, 0)
    if place not in (None, 2**64 - 1):
        ctypes.memmove(place, SECRET, len(SECRET))


def _recall_queue():
    text = ctypes.create_string_buffer(100)
    _libc.msgrcv(_libc.msgget(KEY, 0o600), text, 50, 0, 0o4000)
    return text.raw


def _keep_queue():
    text = (1).to_bytes(8, sys.byteorder) + SECRET
    _libc.msgsnd(_libc.msgget(KEY, 0o1600), text, len(SECRET), 0o4000)


def _recall_key():
    number = _libc.syscall(249, b"user", b"olne_bench_plugin", None, -4)
    text = ctypes.create_string_buffer(100)
    _libc.syscall(250, 11, number, text, 100)
    return text.raw


def _keep_key():
    _libc.syscall(248, b"user", b"olne_bench_plugin", SECRET, len(SECRET), -4)


def _recall_time():
    return SECRET if Path(__file__).stat().st_mtime == KEY else b""


def _keep_time():
    os.utime(__file__, (KEY, KEY))


def _recall_mode():
    return SECRET if Path(__file__).stat().st_mode & 0o1000 else b""


def _keep_mode():
    Path(__file__).chmod(0o1644)


def _recall_limit():
    return SECRET if resource.getrlimit(resource.RLIMIT_MSGQUEUE)[0] == KEY else b""


def _keep_limit():
    resource.prlimit(os.getppid(), resource.RLIMIT_MSGQUEUE, (KEY, KEY))


def _recall_priority():
    return SECRET if os.getpriority(os.PRIO_PROCESS, os.getppid()) == 7 else b""


def _keep_priority():
    os.setpriority(os.PRIO_PROCESS, os.getppid(), 7)


def _recall_processor():
    return SECRET if len(os.sched_getaffinity(0)) == 1 else b""


def _keep_processor():
    os.sched_setaffinity(os.getppid(), {min(os.sched_getaffinity(0))})


def _recall_version():
    with Path(__file__).open() as file:
        found = fcntl.ioctl(file, 0x80087601, bytes(8))  # FS_IOC_GETVERSION
    return SECRET if int.from_bytes(found[:4], sys.byteorder) == KEY else b""


def _keep_version():
    with Path(__file__).open() as file:
        fcntl.ioctl(file, 0x40087602, KEY.to_bytes(8, sys.byteorder))  # FS_IOC_SETVERSION


def _recall_hint():
    with Path(__file__).open() as file:
        found = fcntl.fcntl(file, 1035, bytes(8))  # F_GET_RW_HINT
    return SECRET if found[0] == 3 else b""


def _keep_hint():
    with Path(__file__).open() as file:
        fcntl.fcntl(file, 1036, (3).to_bytes(8, sys.byteorder))  # F_SET_RW_HINT


def _recall_flags():
    return SECRET if fcntl.fcntl(0, fcntl.F_GETFL) & os.O_APPEND else b""


def _keep_flags():
    fcntl.fcntl(0, fcntl.F_SETFL, fcntl.fcntl(0, fcntl.F_GETFL) | os.O_APPEND)


PLACES = {
    "module": (lambda: _kept.get("a", b""), lambda: _kept.update(a=SECRET)),
    "class": (lambda: Remembers.kept, lambda: setattr(Remembers, "kept", SECRET)),
    "builtins": (
        lambda: getattr(builtins, "kept", b""),
        lambda: setattr(builtins, "kept", SECRET),
    ),
    "numpy": (lambda: getattr(np, "kept", b""), lambda: setattr(np, "kept", SECRET)),
    "variable": (
        lambda: os.environ.get("KEPT", "").encode(),
        lambda: os.environ.update(KEPT=SECRET.decode()),
    ),
    "random numbers": (
        lambda: SECRET if np.random.get_state()[1][0] == KEY else b"",  # noqa: NPY002
        lambda: np.random.seed(KEY),  # noqa: NPY002
    ),
    "mapped memory": (lambda: _mapped[: len(SECRET)], lambda: _mapped.write(SECRET)),
    "own folder": _in_file("."),
    "folder above": _in_file(".."),
    "temporary folder": _in_file(tempfile.gettempdir()),
    "/tmp": _in_file("/tmp"),
    "/var/tmp": _in_file("/var/tmp"),
    "/dev/shm": _in_file("/dev/shm"),
    "home": _in_file(Path.home()),
    "beside itself": _in_file(Path(__file__).parent),
    "beside the interpreter": _in_file(sys.prefix),
    "cache": _in_file(os.environ.get("OLNE_BENCH_CACHE", ".")),
    "segment": (_recall_segment, _keep_segment),
    "queue": (_recall_queue, _keep_queue),
    "key": (_recall_key, _keep_key),
    "time of its file": (_recall_time, _keep_time),
    "mode of its file": (_recall_mode, _keep_mode),
    "limit of its parent": (_recall_limit, _keep_limit),
    "priority of its parent": (_recall_priority, _keep_priority),
    "processor of its parent": (_recall_processor, _keep_processor),
    "version of its file": (_recall_version, _keep_version),
    "flags of its input": (_recall_flags, _keep_flags),
    "hint on its file": (_recall_hint, _keep_hint),
    "log": (lambda: Path("/proc/self/fd/1").read_bytes(), lambda: print(SECRET.decode())),
}


class Remembers:
    """Says which places still hold what it left there in a former trial."""

    name = "Remembers"
    kept = b""

    def estimate(self, problem, observation, *, rng, budget):
        found = []
        for place, (recall, _) in PLACES.items():
            with suppress(Exception):
                if SECRET in recall():
                    found.append(place)
        for _, keep in PLACES.values():
            with suppress(Exception):
                keep()
        shape = (problem.game.num_players, problem.game.num_weights)
        return SimpleNamespace(weights=np.ones(shape), message=json.dumps(found))


def _privileges():
    said = set()
    for status in Path("/proc/self/task").glob("*/status"):
        fields = dict(line.split(":\t") for line in status.read_text().splitlines())
        said.add(f"{fields['CapEff'].strip('0')}{fields['NoNewPrivs']}{fields['Seccomp']}")
    return said


class Leaves:
    """Has its code run in every thread that there is, and says what that could read."""

    name = "Leaves"

    def estimate(self, problem, observation, *, rng, budget):
        secrets = json.loads(Path(__file__).with_suffix(".json").read_text())
        read, threads = set(), set()

        def look(*_arguments, **_more):
            threads.add(threading.get_native_id())
            for path in secrets:
                with suppress(OSError):
                    os.close(os.open(path, os.O_RDONLY))
                    read.add(path)
                with suppress(OSError):
                    os.close(os.open(path, os.O_WRONLY))
                    read.add(path)
            return 1

        sleep = time.sleep
        for module in list(sys.modules.values()):
            for name in ("sleep", "getppid", "wait", "poll", "select", "kill_descendants"):
                if callable(getattr(module, name, None)) and module is not sys:
                    with suppress(Exception):
                        setattr(module, name, look)
        threading.Thread(target=look).start()
        look()
        sleep(1.5)
        shape = (problem.game.num_players, problem.game.num_weights)
        said = {"read": sorted(read), "privileges": sorted(_privileges())}
        return SimpleNamespace(weights=np.ones(shape), message=json.dumps(said))
