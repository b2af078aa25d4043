"""A sandbox for foreign code, which a process imposes on itself and its descendants for good.

Restrictions bind the calling thread and what it starts. So a process restricts itself before it
has a second thread, and before it imports foreign code. Four mechanisms of Linux take part:
capabilities are given up, new privileges are refused, Landlock allows files by a list, and a filter
refuses system calls that lead to other processes (``system_calls``). Kernels before 5.13 and other
systems lack Landlock, and older kernels support a part of it: ``restrictions`` says what this
machine prevents. docs/isolation.md says what stays open.
"""

import ctypes
import os
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from olne_bench.bench.process.system_calls import filter_system_calls, filters_system_calls

# linux/landlock.h and asm-generic/unistd.h
_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_RULE_PATH_BENEATH = 1
_VERSION_FLAG = 1
_EXECUTE, _WRITE_FILE, _READ_FILE, _READ_DIR = 1, 2, 4, 8
_FILE_RIGHTS = _EXECUTE | _WRITE_FILE | _READ_FILE | 1 << 14 | 1 << 15  # truncate, ioctl
_ALL_RIGHTS = {1: 2**13 - 1, 2: 2**14 - 1, 3: 2**15 - 1, 4: 2**15 - 1, 5: 2**16 - 1}
_NET_RIGHTS = 3  # bind and connect TCP
_SCOPES = 3  # abstract sockets and signals
_CAPABILITY_BOUND_DROP, _NO_NEW_PRIVS = 24, 38  # linux/prctl.h
_CAPABILITY_VERSION = 0x20080522  # linux/capability.h
_CAPABILITIES = 64
_FIRST_WITH_NET, _FIRST_WITH_SCOPES = 4, 6

#: Devices that ordinary programs read and write. None of them keeps what is written.
_DEVICES = ("/dev/null", "/dev/zero", "/dev/full", "/dev/random", "/dev/urandom")


class _Ruleset(ctypes.Structure):
    _fields_ = (("fs", ctypes.c_uint64), ("net", ctypes.c_uint64), ("scoped", ctypes.c_uint64))


class _PathBeneath(ctypes.Structure):
    _pack_ = 1
    _fields_ = (("allowed", ctypes.c_uint64), ("parent", ctypes.c_int32))


class _CapabilityHeader(ctypes.Structure):
    _fields_ = (("version", ctypes.c_uint32), ("pid", ctypes.c_int))


def landlock_version() -> int:
    """Version of Landlock's interface; 0 if there is none."""
    if sys.platform != "linux":
        return 0
    return max(0, int(_libc().syscall(_CREATE_RULESET, None, 0, _VERSION_FLAG)))


def scopes_signals() -> bool:
    """Whether a restricted process cannot send signals to those outside of its sandbox."""
    return landlock_version() >= _FIRST_WITH_SCOPES


def restrictions() -> tuple[str, ...]:
    """What a sandbox denies foreign code on this machine."""
    version, filtered = landlock_version(), filters_system_calls()
    found = []
    if version:
        found += ["the run folder", "all files but a list", "writing outside of its folder"]
    if version >= _FIRST_WITH_NET or filtered:
        found += ["TCP connections"]
    if filtered:
        found += ["all other connections", "shared memory and queues", "files' owners and times"]
    if scopes_signals():
        found += ["signals to other processes"]
    return tuple(found)


def restrict(readable: Sequence[Path], listable: Sequence[Path], writable: Path) -> None:
    """Restrict this thread, and all that it starts, as far as the kernel can.

    Args:
        readable: files, and folders with all below them, that can be read and run.
        listable: folders of which the names of all files below can be seen.
        writable: the only folder that can be written to.

    Raises:
        OSError: if the kernel could restrict it, and refuses.
    """
    if sys.platform != "linux":
        return
    _drop_capabilities()
    _libc().prctl(_NO_NEW_PRIVS, 1, 0, 0, 0)
    rules = rules_for(readable, listable, writable)
    if rules is not None:
        enforce(rules)
    filter_system_calls()


def rules_for(readable: Sequence[Path], listable: Sequence[Path], writable: Path) -> int | None:
    """Descriptor of a set of rules for ``enforce``, as of ``restrict``; None without Landlock.

    A process that is restricted already is restricted further: what remains is what both allow.
    """
    version = landlock_version()
    if not version:
        return None
    rights = _ALL_RIGHTS[min(version, max(_ALL_RIGHTS))]
    ruleset = _Ruleset(
        rights,
        _NET_RIGHTS if version >= _FIRST_WITH_NET else 0,
        _SCOPES if version >= _FIRST_WITH_SCOPES else 0,
    )
    size = 8 if version < _FIRST_WITH_NET else 16 if version < _FIRST_WITH_SCOPES else 24
    rules = int(_libc().syscall(_CREATE_RULESET, ctypes.byref(ruleset), size, 0))
    if rules < 0:
        raise OSError("this kernel has Landlock, and refuses to make a set of rules")
    for place in readable:
        allow_reading(rules, place)
    for place in listable:
        _allow(rules, place, _READ_DIR)
    for device in _DEVICES:
        _allow(rules, Path(device), _READ_FILE | _WRITE_FILE)
    _allow(rules, writable, rights & ~_EXECUTE)  # what was compiled there is loaded, not run
    return rules


def allow_reading(rules: int, place: Path) -> None:
    """Let a set of rules allow to read and run a file, or all below a folder."""
    _allow(rules, place, _EXECUTE | _READ_FILE | _READ_DIR)


def enforce(rules: int) -> None:
    """Restrict this thread, and all that it starts, to a set of rules, and close that.

    Raises:
        OSError: if the kernel refuses.
    """
    refused = _libc().syscall(_RESTRICT_SELF, rules, 0)
    os.close(rules)
    if refused:
        raise OSError("this kernel has Landlock, and refuses to restrict a process")


def _drop_capabilities() -> None:
    """Give up the privileges of a superuser, such as reading other processes, for good."""
    for capability in range(_CAPABILITIES):  # those that do not exist are refused
        _libc().prctl(_CAPABILITY_BOUND_DROP, capability, 0, 0, 0)
    header = _CapabilityHeader(_CAPABILITY_VERSION, 0)
    _libc().capset(ctypes.byref(header), (ctypes.c_uint32 * 6)())


def _allow(ruleset: int, place: Path, rights: int) -> None:
    try:
        descriptor = os.open(place, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        is_folder = os.path.isdir(f"/proc/self/fd/{descriptor}")  # noqa: PTH112
        rule = _PathBeneath(rights if is_folder else rights & _FILE_RIGHTS, descriptor)
        _libc().syscall(_ADD_RULE, ruleset, _RULE_PATH_BENEATH, ctypes.byref(rule), 0)
    finally:
        os.close(descriptor)


@cache
def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)
