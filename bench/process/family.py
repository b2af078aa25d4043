"""Find and kill the descendants of a process, even those that left its session or their parent.

On Linux a process can adopt the orphans of its descendants (as a "child subreaper"), so no process
escapes by ``setsid`` or when its parent ends. Elsewhere such orphans are not found.
"""

import ctypes
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import psutil

_PR_SET_PDEATHSIG = 1  # linux/prctl.h
_PR_SET_CHILD_SUBREAPER = 36
_IN_MEMORY = ("/memfd:", "/dev/shm/")
#: Nothing is left after this number of searches in a row without a find.
_QUIET_LOOKS = 3
#: After this time [s], a family that forks faster than it can be killed is given up.
_KILL_SECONDS = 10.0
#: How often a process is looked at while its end is waited for [s].
_LOOK_SECONDS = 0.005


_adopts = False


def adopts_orphans() -> bool:
    """Whether this process becomes the parent of descendants whose parents end."""
    return _adopts


def adopt_orphans() -> None:
    """Become the parent of descendants whose parents end."""
    global _adopts
    _adopts = sys.platform == "linux"
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def end_with_parent(parent: int) -> None:
    """Have this process killed when its parent, of this process id, ends."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
        if os.getppid() != parent:  # it has ended already
            os._exit(1)


def has_descendants(pid: int) -> bool:
    """Whether a process has children that have not been waited for."""
    return any(_children(pid))


def ends_within(ended: Callable[[], bool], seconds: float) -> bool:
    """Whether a process has ended, as ``ended`` says, after so many seconds at most."""
    deadline = time.monotonic() + seconds
    while not ended():
        if time.monotonic() > deadline:
            return False
        time.sleep(_LOOK_SECONDS)
    return True


def has_ended(pid: int) -> bool:
    """Whether a process has ended, whether or not its parent has waited for it."""
    try:
        return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True
    except psutil.Error:
        return False


def kill_family(pid: int) -> None:
    """Kill the descendants of a process, and then the process itself.

    The process is stopped first. As it adopts orphans, all of them are found below it.
    """
    with suppress(ProcessLookupError, PermissionError):
        os.kill(pid, signal.SIGSTOP)
    kill_descendants(pid)
    with suppress(ProcessLookupError, PermissionError):
        os.kill(pid, signal.SIGKILL)


def kill_descendants(pid: int, keep: frozenset[int] = frozenset()) -> None:
    """Kill the descendants of a process, except some children and their descendants.

    A process that forks and ends during a search hides its child from this search, but not from
    the next ones.
    """
    deadline = time.monotonic() + _KILL_SECONDS
    quiet = 0
    while quiet < _QUIET_LOOKS and time.monotonic() < deadline:
        alive = [one for one in _below(pid, keep) if _kill(one)]
        quiet = 0 if alive else quiet + 1
        if alive:
            psutil.wait_procs(alive, timeout=0.05)


def kill_sandbox() -> None:
    """Kill all other processes of this one's sandbox at once, however fast they fork.

    Only for a process that cannot signal others (``sandbox.scopes_signals``, after ``restrict``).
    """
    with suppress(ProcessLookupError, PermissionError):
        os.kill(-1, signal.SIGKILL)
    with suppress(ChildProcessError):
        while True:
            os.wait()


def held_memory(pid: int, *, descendants: bool = True) -> int:
    """Memory [bytes] that a process and its descendants hold, shared memory included.

    Memory that several processes share counts once for each. On Linux, open files in memory count
    as well, and count again if they are mapped.
    """
    total = 0
    files: dict[tuple[int, int], int] = {}
    with suppress(psutil.Error):
        process = psutil.Process(pid)
        below = process.children(recursive=True) if descendants else []
        for one in [process, *below]:
            with suppress(psutil.Error):
                held = one.memory_info()
                total += held.rss
                files |= _files_in_memory(one.pid)
    return total + sum(files.values())


def _files_in_memory(pid: int) -> dict[tuple[int, int], int]:
    """Sizes [bytes] of a process's open files in memory, by device and inode number."""
    found = {}
    with suppress(OSError):
        for link in Path(f"/proc/{pid}/fd").iterdir():
            with suppress(OSError):
                if str(link.readlink()).startswith(_IN_MEMORY):
                    known = link.stat()
                    found[known.st_dev, known.st_ino] = 512 * known.st_blocks
    return found


def _below(pid: int, keep: frozenset[int]) -> Iterator[psutil.Process]:
    for child in list(_children(pid)):
        if child not in keep:
            yield from _below(child, frozenset())
            with suppress(psutil.Error):
                yield psutil.Process(child)


def _kill(process: psutil.Process) -> bool:
    """Kill a process; False if it is dead already."""
    with suppress(psutil.Error):
        if process.status() != psutil.STATUS_ZOMBIE:
            process.kill()
            return True
    return False


def _children(pid: int) -> Iterator[int]:
    """Children of a process. Called after every trial, so the fast way comes first."""
    tasks = Path(f"/proc/{pid}/task")
    try:
        for task in tasks.iterdir():
            with suppress(FileNotFoundError, ProcessLookupError):  # the thread has just ended
                yield from map(int, (task / "children").read_text().split())
    except OSError:
        with suppress(psutil.Error):
            yield from (child.pid for child in psutil.Process(pid).children())
