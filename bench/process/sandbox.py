"""A sandbox for foreign code: Linux's Landlock, which a process imposes on itself permanently.

Restricted code has no superuser privileges. It can read any file except those below hidden folders,
and write below one folder. It cannot open TCP connections, send signals to processes outside the
sandbox or look into them. Kernels before 5.13 and other systems have no Landlock. Older kernels
support a part of this (``restrictions`` says which); see docs/isolation.md.
"""

import ctypes
import os
import sys
from collections.abc import Sequence
from pathlib import Path

# linux/landlock.h and asm-generic/unistd.h
_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_RULE_PATH_BENEATH = 1
_VERSION_FLAG = 1
_EXECUTE, _WRITE_FILE, _READ_FILE, _READ_DIR = 1, 2, 4, 8
_FILE_RIGHTS = _EXECUTE | _WRITE_FILE | _READ_FILE | 1 << 14 | 1 << 15  # truncate, ioctl
_ALL_RIGHTS = {1: 2**13 - 1, 2: 2**14 - 1, 3: 2**15 - 1, 4: 2**15 - 1, 5: 2**16 - 1}
_NET_RIGHTS = 3  # bind and connect TCP
_SCOPES = 3  # abstract sockets and signals
_NO_NEW_PRIVS = 38  # linux/prctl.h
_CAPABILITY_VERSION = 0x20080522  # linux/capability.h
_FIRST_WITH_NET, _FIRST_WITH_SCOPES = 4, 6

#: Devices that ordinary programs write to.
_DEVICES = ("/dev/null", "/dev/zero", "/dev/full", "/dev/tty", "/dev/shm")


class _Ruleset(ctypes.Structure):
    _fields_ = (("fs", ctypes.c_uint64), ("net", ctypes.c_uint64), ("scoped", ctypes.c_uint64))


class _PathBeneath(ctypes.Structure):
    _pack_ = 1
    _fields_ = (("allowed", ctypes.c_uint64), ("parent", ctypes.c_int32))


def landlock_version() -> int:
    """Version of Landlock's interface; 0 if there is none."""
    if sys.platform != "linux":
        return 0
    return max(0, int(_libc().syscall(_CREATE_RULESET, None, 0, _VERSION_FLAG)))


def restrictions() -> tuple[str, ...]:
    """What ``restrict`` denies foreign code on this machine."""
    version = landlock_version()
    found = ["the run folder", "writing outside of its folder"] if version else []
    found += ["TCP connections"] if version >= _FIRST_WITH_NET else []
    found += ["signals to other processes"] if version >= _FIRST_WITH_SCOPES else []
    return tuple(found)


class _CapabilityHeader(ctypes.Structure):
    _fields_ = (("version", ctypes.c_uint32), ("pid", ctypes.c_int))


def drop_capabilities() -> None:
    """Give up the privileges of a superuser, such as reading other processes."""
    if sys.platform == "linux":
        header = _CapabilityHeader(_CAPABILITY_VERSION, 0)
        _libc().capset(ctypes.byref(header), (ctypes.c_uint32 * 6)())


def restrict(hidden: Sequence[Path], writable: Path) -> None:
    """Restrict this process and its descendants as far as the kernel can.

    Args:
        hidden: folders whose files cannot be read, even if they are created later.
        writable: the only folder that can be written to.
    """
    drop_capabilities()
    version = landlock_version()
    if not version:
        return
    rights = _ALL_RIGHTS[min(version, max(_ALL_RIGHTS))]
    ruleset = _Ruleset(
        rights,
        _NET_RIGHTS if version >= _FIRST_WITH_NET else 0,
        _SCOPES if version >= _FIRST_WITH_SCOPES else 0,
    )
    size = 8 if version < _FIRST_WITH_NET else 16 if version < _FIRST_WITH_SCOPES else 24
    libc = _libc()
    descriptor = libc.syscall(_CREATE_RULESET, ctypes.byref(ruleset), size, 0)
    if descriptor < 0:
        return
    try:
        _allow(descriptor, Path("/"), _READ_DIR)
        for place in _around(hidden):
            _allow(descriptor, place, _EXECUTE | _READ_FILE | _READ_DIR)
        for place in (writable, *map(Path, _DEVICES)):
            _allow(descriptor, place, rights)
        libc.prctl(_NO_NEW_PRIVS, 1, 0, 0, 0)
        libc.syscall(_RESTRICT_SELF, descriptor, 0)
    finally:
        os.close(descriptor)


def _around(hidden: Sequence[Path]) -> list[Path]:
    """Files and folders that together are everything but the hidden folders."""
    return _outside(Path("/"), [folder.resolve() for folder in hidden])


def _outside(place: Path, hidden: list[Path]) -> list[Path]:
    """The parts of a place outside the hidden folders, which are below it or the place itself."""
    if not hidden:
        return [place]
    if place in hidden:
        return []
    try:
        # A link is not followed: it may lead into a hidden folder.
        entries = [entry for entry in place.iterdir() if not entry.is_symlink()]
    except OSError:  # it does not exist yet, or cannot be listed
        return []
    return [
        found
        for entry in entries
        for found in _outside(entry, [h for h in hidden if h == entry or entry in h.parents])
    ]


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


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)
