"""A filter of system calls (seccomp): refuses what leads from a process to others or to the kernel.

Landlock guards files. This filter closes what it does not: sockets of all kinds, shared memory,
queues and keys that outlive a process, locks and watches on files that others can see, and owners,
modes and times of files, which would be a memory beside their content.
"""

import ctypes
import platform
import struct
import sys
from collections.abc import Iterator
from errno import EACCES, ENOLCK, ENOSYS

_SET_SECCOMP, _MODE_FILTER = 22, 2  # linux/prctl.h, linux/seccomp.h
_GET_SECCOMP = 21
_ALLOW, _FAIL = 0x7FFF0000, 0x00050000
_LOAD, _EQUAL, _AT_LEAST, _RETURN = 0x20, 0x15, 0x35, 0x06  # linux/bpf_common.h
_NUMBER, _ARCHITECTURE, _SECOND_ARGUMENT = 0, 4, 24  # places in struct seccomp_data
_OTHER_NUMBERS = 0x40000000  # x86-64 has a second set of numbers from here on

#: Name of the architecture in Linux, and the place of its numbers in the tables below.
_ARCHITECTURES = {"x86_64": (0xC000003E, 0), "aarch64": (0xC00000B7, 1)}

#: Numbers of refused calls on x86-64 and AArch64; None where there is no such call.
_REFUSED: dict[str, tuple[int | None, int | None]] = {
    # Connections. A pair of sockets within the process stays possible.
    "socket": (41, 198),
    "io_uring_setup": (425, 425),
    # What outlives a process.
    "shmget": (29, 194),
    "semget": (64, 190),
    "msgget": (68, 186),
    "mq_open": (240, 180),
    "mq_unlink": (241, 181),
    "add_key": (248, 217),
    "request_key": (249, 218),
    "keyctl": (250, 219),
    # Watches on what others do.
    "inotify_init": (253, None),
    "inotify_init1": (294, 26),
    "fanotify_init": (300, 262),
    "perf_event_open": (298, 241),
    "ptrace": (101, 117),
    "process_vm_readv": (310, 270),
    "process_vm_writev": (311, 271),
    "pidfd_getfd": (438, 438),
    "kcmp": (312, 272),
    # Ways into the kernel that no estimator needs.
    "bpf": (321, 280),
    "userfaultfd": (323, 282),
    "unshare": (272, 97),
    "setns": (308, 268),
    "mount": (165, 40),
    "umount2": (166, 39),
    "pivot_root": (155, 41),
    "chroot": (161, 51),
    # Attributes of files.
    "setxattr": (188, 5),
    "lsetxattr": (189, 6),
    "fsetxattr": (190, 7),
    "setxattrat": (463, 463),
    "removexattr": (197, 14),
    "lremovexattr": (198, 15),
    "fremovexattr": (199, 16),
    "removexattrat": (466, 466),
}

#: Calls that do nothing and report success: programs such as compilers and ``shutil.copy`` make
#: them in passing, and Landlock has no right for them.
_WITHOUT_EFFECT: dict[str, tuple[int | None, int | None]] = {
    "chmod": (90, None),
    "fchmod": (91, 52),
    "fchmodat": (268, 53),
    "fchmodat2": (452, 452),
    "chown": (92, None),
    "fchown": (93, 55),
    "lchown": (94, None),
    "fchownat": (260, 54),
    "utime": (132, None),
    "utimes": (235, None),
    "futimesat": (261, None),
    "utimensat": (280, 88),
}

#: Locks on files: there are none.
_LOCKING: dict[str, tuple[int | None, int | None]] = {"flock": (73, 32)}
_FILE_CONTROL = (72, 25)
#: Commands of ``fcntl`` that lock or watch a file (linux/fcntl.h).
_LOCK_COMMANDS = (6, 7, 37, 38, 1024, 1026)


class _Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("code", ctypes.c_char_p))


def filters_system_calls() -> bool:
    """Whether there is a filter for this machine."""
    known = sys.platform == "linux" and platform.machine() in _ARCHITECTURES
    return known and ctypes.CDLL(None).prctl(_GET_SECCOMP, 0, 0, 0, 0) >= 0


def filter_system_calls() -> None:
    """Refuse calls in this thread, and in all that it starts, for good.

    The thread must have given up new privileges (``sandbox.restrict``).

    Raises:
        OSError: if the kernel has filters, and refuses this one.
    """
    if not filters_system_calls():
        return
    code = b"".join(_program(*_ARCHITECTURES[platform.machine()]))
    program = _Program(len(code) // 8, code)
    if ctypes.CDLL(None).prctl(_SET_SECCOMP, _MODE_FILTER, ctypes.byref(program), 0, 0):
        raise OSError("the kernel refuses a filter of system calls")


def _program(architecture: int, column: int) -> Iterator[bytes]:
    """Instructions of the filter; each jump passes over one instruction."""
    yield _instruction(_LOAD, _ARCHITECTURE)
    yield _instruction(_EQUAL, architecture, 1, 0)
    yield _instruction(_RETURN, _FAIL | ENOSYS)
    yield _instruction(_LOAD, _NUMBER)
    yield _instruction(_AT_LEAST, _OTHER_NUMBERS, 0, 1)
    yield _instruction(_RETURN, _FAIL | ENOSYS)
    for calls, error in ((_REFUSED, EACCES), (_WITHOUT_EFFECT, 0), (_LOCKING, ENOLCK)):
        for numbers in calls.values():
            number = numbers[column]
            if number is not None:
                yield _instruction(_EQUAL, number, 0, 1)
                yield _instruction(_RETURN, _FAIL | error)
    yield _instruction(_EQUAL, _FILE_CONTROL[column], 1, 0)
    yield _instruction(_RETURN, _ALLOW)
    yield _instruction(_LOAD, _SECOND_ARGUMENT)
    for command in _LOCK_COMMANDS:
        yield _instruction(_EQUAL, command, 0, 1)
        yield _instruction(_RETURN, _FAIL | ENOLCK)
    yield _instruction(_RETURN, _ALLOW)


def _instruction(code: int, value: int, then: int = 0, otherwise: int = 0) -> bytes:
    return struct.pack("HBBI", code, then, otherwise, value)
