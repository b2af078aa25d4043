"""A filter of system calls (seccomp): refuses what leads from a process to others or to the kernel.

Landlock guards files. This filter closes what it does not: sockets of all kinds, shared memory,
queues and keys that outlive a process, limits and priorities of other processes, namespaces, locks
and watches on files that others can see, and attributes of files, which would be a memory beside
their content.
"""

import ctypes
import platform
import struct
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from errno import EACCES, ENOLCK, ENOSYS, ENOTTY, EPERM

_SET_SECCOMP, _MODE_FILTER = 22, 2  # linux/prctl.h, linux/seccomp.h
_GET_SECCOMP = 21
_ALLOW, _FAIL = 0x7FFF0000, 0x00050000
_LOAD, _AND, _EQUAL, _AT_LEAST, _RETURN = 0x20, 0x54, 0x15, 0x35, 0x06  # linux/bpf_common.h
_NUMBER, _ARCHITECTURE, _ARGUMENTS = 0, 4, 16  # places in struct seccomp_data
_OTHER_NUMBERS = 0x40000000  # x86-64 has a second set of numbers from here on

#: Name of the architecture in Linux, and the place of its numbers in the tables below.
_ARCHITECTURES = {"x86_64": (0xC000003E, 0), "aarch64": (0xC00000B7, 1)}

#: Numbers of refused calls on x86-64 and AArch64; None where there is no such call.
_REFUSED: dict[str, tuple[int | None, int | None]] = {
    # Connections. A pair of sockets within the process stays possible.
    "socket": (41, 198),
    "bind": (49, 200),
    "listen": (50, 201),
    "accept": (43, 202),
    "accept4": (288, 242),
    "connect": (42, 203),
    "io_uring_setup": (425, 425),
    # What outlives a process.
    "shmget": (29, 194),
    "semget": (64, 190),
    "msgget": (68, 186),
    "mq_open": (240, 180),
    "mq_unlink": (241, 181),
    # Memory that no limit counts.
    "memfd_create": (319, 279),
    "memfd_secret": (447, 447),
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
    "ioprio_set": (251, 30),
    # Ways into the kernel that no estimator needs.
    "bpf": (321, 280),
    "userfaultfd": (323, 282),
    "unshare": (272, 97),
    "setns": (308, 268),
    "mount": (165, 40),
    "umount2": (166, 39),
    "pivot_root": (155, 41),
    "chroot": (161, 51),
    "open_tree": (428, 428),
    "move_mount": (429, 429),
    "fsopen": (430, 430),
    "fsconfig": (431, 431),
    "fsmount": (432, 432),
    "fspick": (433, 433),
    "mount_setattr": (442, 442),
    "open_tree_attr": (467, 467),
    # Attributes of files.
    "setxattr": (188, 5),
    "lsetxattr": (189, 6),
    "fsetxattr": (190, 7),
    "setxattrat": (463, 463),
    "removexattr": (197, 14),
    "lremovexattr": (198, 15),
    "fremovexattr": (199, 16),
    "removexattrat": (466, 466),
    "file_setattr": (469, 469),
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

#: Calls that libraries do without where the kernel has none: ``clone3`` hides its flags in memory.
_MISSING: dict[str, tuple[int | None, int | None]] = {"clone3": (435, 435)}

#: Locks on files: there are none.
_LOCKING: dict[str, tuple[int | None, int | None]] = {"flock": (73, 32)}


@dataclass(frozen=True)
class _Condition:
    """An argument of a call that is allowed.

    Attributes:
        place: where its 32 bits are in struct seccomp_data.
        values: allowed values.
        mask: the bits that count.
    """

    place: int
    values: tuple[int, ...]
    mask: int = 0xFFFFFFFF

    def instructions(self, error: int) -> list[bytes]:
        """Fail with an error unless it holds; its length is less than 256."""
        code = [_instruction(_LOAD, self.place), _instruction(_AND, self.mask)]
        for left in reversed(range(len(self.values))):
            code.append(_instruction(_EQUAL, self.values[-1 - left], left + 1, 0))
        return [*code, _instruction(_RETURN, _FAIL | error)]


def _argument(number: int, *values: int, mask: int = 0xFFFFFFFF) -> _Condition:
    """A condition on the lower half of an argument, counted from 0."""
    return _Condition(_ARGUMENTS + 8 * number, values, mask)


#: Only the caller itself: its process is 0.
_ITSELF = (_argument(0, 0),)
#: CLONE_PARENT, and a new namespace of any kind (linux/sched.h).
_UNUSUAL_CHILD = 0x8000 | 0x20000 | 0x7E000000
_STREAM, _KIND_OF_SOCKET = 1, 0xF
_SHARED, _ANONYMOUS = 1, 0x20  # linux/mman.h
#: Commands of ``ioctl`` about terminals and pipes (asm/ioctls.h): TCGETS, TIOCGPGRP, TIOCGWINSZ,
#: FIONREAD, FIONBIO, FIONCLEX, FIOCLEX and TCGETS2.
_DEVICE_COMMANDS = (0x5401, 0x540F, 0x5413, 0x541B, 0x5421, 0x5450, 0x5451, 0x802C542A)
#: Commands of ``fcntl`` about descriptors and pipes (linux/fcntl.h): F_DUPFD to F_SETFL,
#: F_DUPFD_CLOEXEC, F_SETPIPE_SZ, F_GETPIPE_SZ and F_GET_SEALS. Others lock, watch or mark a file.
_FILE_COMMANDS = (0, 1, 2, 3, 4, 1030, 1031, 1032, 1034)

#: Calls that are allowed on conditions: numbers, conditions, and the error where one fails.
_CONDITIONAL: dict[str, tuple[tuple[int, int], tuple[_Condition, ...], int]] = {
    "prlimit64": ((302, 261), _ITSELF, EPERM),
    "sched_setaffinity": ((203, 122), _ITSELF, EPERM),
    "sched_setparam": ((142, 118), _ITSELF, EPERM),
    "sched_setscheduler": ((144, 119), _ITSELF, EPERM),
    "sched_setattr": ((314, 274), _ITSELF, EPERM),
    "setpriority": ((141, 140), (_argument(0, 0), _argument(1, 0)), EPERM),
    "clone": ((56, 220), (_argument(0, 0, mask=_UNUSUAL_CHILD),), EPERM),
    "socketpair": ((53, 199), (_argument(1, _STREAM, mask=_KIND_OF_SOCKET),), EACCES),
    # To an address: both halves of a pointer.
    "sendto": (
        (44, 206),
        (_argument(4, 0), _Condition(_ARGUMENTS + 8 * 4 + 4, (0,))),
        EACCES,
    ),
    "mmap": (
        (9, 222),
        (_argument(3, 0, _SHARED, _ANONYMOUS, mask=_SHARED | _ANONYMOUS),),
        EPERM,
    ),
    "ioctl": ((16, 29), (_argument(1, *_DEVICE_COMMANDS),), ENOTTY),
    "fcntl": ((72, 25), (_argument(1, *_FILE_COMMANDS),), ENOLCK),
}


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
    for calls, error in (
        (_REFUSED, EACCES),
        (_WITHOUT_EFFECT, 0),
        (_LOCKING, ENOLCK),
        (_MISSING, ENOSYS),
    ):
        for numbers in calls.values():
            number = numbers[column]
            if number is not None:
                yield _instruction(_EQUAL, number, 0, 1)
                yield _instruction(_RETURN, _FAIL | error)
    for known, conditions, error in _CONDITIONAL.values():
        block = [one for condition in conditions for one in condition.instructions(error)]
        yield _instruction(_EQUAL, known[column], 0, len(block) + 1)
        yield from block
        yield _instruction(_RETURN, _ALLOW)
    yield _instruction(_RETURN, _ALLOW)


def _instruction(code: int, value: int, then: int = 0, otherwise: int = 0) -> bytes:
    return struct.pack("HBBI", code, then, otherwise, value)
