"""Compiles C source to libraries and keeps them in a folder that only their owner can write to.

A library may be made of several sources, whose objects are kept, as other libraries share them.
A file's name holds two digests: one of source, flags and compiler, and one of its bytes.
One that does not match its name or cannot be trusted (``olne_bench.kept_files``) is compiled again.

Code is compiled for one of two kinds of processor, which ``backend`` names, not for the present
one: x86-64 with AVX2 and FMA, which almost all have since 2013, or the generic architecture. So the
same source and compiler give the same machine code on all machines of a kind. The compiler may
reorder sums (``-fassociative-math``). Functions of the C library such as ``sin`` may still differ
in the last digits between processor families, as in NumPy.

Environment: ``CC`` names the compiler (``cc``, or else the clang of the package ``ziglang``, extra
``compiler``), ``OLNE_BENCH_CFLAGS`` further flags, ``OLNE_BENCH_CACHE`` the folder (default
``$XDG_CACHE_HOME/olne-bench``, then ``~/.cache/olne-bench``).
"""

import ctypes
import fcntl
import hashlib
import importlib.util
import os
import re
import shlex
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path

from olne_bench.errors import UserError
from olne_bench.kept_files import (
    SHARED,
    folders_of_others,
    kept_folder,
    remove_oldest,
    warn,
    why_foreign,
)

#: Largest total size of libraries and objects [bytes].
SIZE_LIMIT = 500_000_000

_FLAGS = (
    *("-O3", "-funroll-loops", "-fPIC", "-fvisibility=hidden"),
    # The compiler may reorder sums; NaN and infinity keep their meaning.
    *("-fno-math-errno", "-fno-trapping-math", "-fno-signed-zeros", "-fassociative-math"),
)
#: Flags of processors with wide vectors, and the source that finds out whether this is one.
_WIDE_FLAGS = ("-mavx2", "-mfma")
_PROBE = """
__attribute__((visibility("default"))) int has_wide_vectors(void)
{
#if defined(__x86_64__)
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
#else
    return 0;
#endif
}
"""
_LONGEST_COMPILATION = 300.0  # [s]
_SCRATCH = "compiling-"
_ABANDONED = 3600.0  # [s] after which a compilation's scratch folder counts as abandoned


@dataclass(frozen=True)
class _Kept:
    """A file that is kept: what compiles it, of which sources, and how its name ends."""

    command: tuple[str, ...]
    flags: tuple[str, ...]
    sources: tuple[str, ...]
    suffix: str  # .so, or .o of an object

    @cached_property
    def key(self) -> str:
        """A digest of all that it is made of."""
        parts = [*self.sources, *self.flags, *_identity(self.command)]
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()

    def name(self, path: Path) -> str:
        """Its name: a digest of its key, and one of key and content, which is in ``path``."""
        content = hashlib.sha256(self.key.encode() + path.read_bytes()).hexdigest()
        return f"{self.key[:32]}-{content[:32]}{self.suffix}"

    def candidates(self, folder: Path) -> list[Path]:
        """Files of a folder that say they are it."""
        return sorted(folder.glob(f"{self.key[:32]}-*{self.suffix}"))


def backend() -> str:
    """What solves games here: ``native: `` and the compiler, its target and further flags.

    Between two compilers results may differ in the last digits, and in outcome on hard problems;
    rows of one backend are comparable. The probe is compiled, kept and loaded like all other code.
    """
    load(_PROBE)
    command = _compiler()
    names = [*_identity(command), *_processor_flags(command), *_further_flags()]
    return f"native: {', '.join(filter(None, names))}"


@lru_cache(maxsize=64)
def load(source: str, *flags: str, shared: tuple[str, ...] = ()) -> ctypes.CDLL:
    """The library of a source, and of others that libraries ``shared``, with further flags.

    UserError without compiler, or if it fails.
    """
    command = _compiler()
    try:
        return _load(command, (source, *shared), (*_processor_flags(command), *flags))
    except OSError as error:
        raise UserError(f"games cannot be compiled: {error}") from error


def has_wide_vectors() -> bool:
    """Whether code is compiled for a processor with vectors of four numbers."""
    return bool(_processor_flags(_compiler()))


def _compiler() -> tuple[str, ...]:
    """The command of the compiler; UserError, which says what to install, if there is none."""
    chosen = os.environ.get("CC")
    if path := shutil.which(chosen or "cc"):
        return (path,)
    package = importlib.util.find_spec("ziglang")
    if chosen or package is None or package.origin is None:
        raise UserError(
            f"no C compiler {chosen or 'cc'!r} found, which compiles the games: install one, name "
            "another by CC, or pip install 'olne-bench[compiler]'"
        )
    # Not for the present processor, which is what it would compile for.
    return str(Path(package.origin).with_name("zig")), "cc", "-mcpu=baseline"


@lru_cache(maxsize=4)
def _identity(command: tuple[str, ...]) -> tuple[str, str]:
    """Version and target of a compiler, such as ``gcc (Debian 12.2.0) 12.2.0``, ``x86_64-...``."""
    version = _run([*command, "--version"]).splitlines() or [""]
    # Compilers with several names report the one by which they were called.
    return re.sub(r"^\S+ \(", "gcc (", version[0]), _run([*command, "-dumpmachine"]).strip()


def _run(command: list[str], **environment: str) -> str:
    try:
        return subprocess.run(
            command,
            check=True,
            capture_output=True,
            text=True,
            timeout=_LONGEST_COMPILATION,
            env=os.environ | environment,
        ).stdout
    except subprocess.CalledProcessError as error:
        reason = (error.stderr.strip() or f"exit code {error.returncode}").splitlines()[0]
        raise UserError(f"games cannot be compiled: {command[0]} failed: {reason}") from error
    except subprocess.TimeoutExpired as error:
        raise UserError(f"{command[0]} took over {error.timeout:g} s to compile") from error


def _further_flags() -> list[str]:
    return shlex.split(os.environ.get("OLNE_BENCH_CFLAGS", ""))


@lru_cache(maxsize=4)
def _processor_flags(command: tuple[str, ...]) -> tuple[str, ...]:
    """Flags of the kind of processor that this is."""
    return _WIDE_FLAGS if _load(command, (_PROBE,)).has_wide_vectors() else ()


def _load(
    command: tuple[str, ...], sources: Sequence[str], further: tuple[str, ...] = ()
) -> ctypes.CDLL:
    flags = [*_FLAGS, *further, *_further_flags()]
    library = _Kept(command, tuple(flags), tuple(sources), ".so")
    try:
        return ctypes.CDLL(str(_made(library)))
    except OSError:  # another process may have removed it just now
        return ctypes.CDLL(str(_compile(library)))


def _made(wanted: _Kept) -> Path:
    """The file, compiled unless it is kept or shared."""
    if shared := _shared(wanted):
        return shared
    if kept := _kept(wanted):
        return kept
    with _alone(wanted):  # another process may compile it meanwhile
        return _kept(wanted) or _compile(wanted)


@contextmanager
def _alone(wanted: _Kept) -> Iterator[None]:
    """Wait for other processes that compile the same; a sandbox has no locks, and needs none."""
    path = _folder() / f"{wanted.key[:32]}.lock"
    with path.open("w") as file:
        with suppress(OSError):
            fcntl.flock(file, fcntl.LOCK_EX)
        yield
        path.unlink(missing_ok=True)


def _compile(wanted: _Kept) -> Path:
    folder, (source, *shared) = _folder(), wanted.sources
    objects = [_made(replace(wanted, sources=(one,), suffix=".o")) for one in shared]
    # Compiled in a scratch folder and moved in one step, so that processes may race.
    with tempfile.TemporaryDirectory(prefix=_SCRATCH, dir=folder) as scratch:
        code, found = Path(scratch, "source.c"), Path(scratch, "found")
        code.write_text(source)
        # Zig keeps what it has made of the C library; its own folder may be out of reach.
        kept = {"ZIG_LOCAL_CACHE_DIR": scratch, "ZIG_GLOBAL_CACHE_DIR": str(folder / "zig")}
        inputs = ["-shared", str(code), *map(str, objects), "-lm"]
        chosen = ["-c", str(code)] if wanted.suffix == ".o" else inputs
        _run([*wanted.command, *wanted.flags, *chosen, "-o", str(found)], **kept)
        found.chmod(0o700)
        path = folder / wanted.name(found)
        found.replace(path)
    _tidy(folder, keep=path)
    return path


def shared_folders() -> list[Path]:
    """Folders of libraries that this process's children may load: its own, and those it shares."""
    return [_folder(), *folders_of_others()]


def reader_environment(own: Path) -> dict[str, str]:
    """Environment for a process that may load our libraries and keeps new ones in ``own``."""
    shared = os.pathsep.join(map(str, shared_folders()))
    return {SHARED: shared, "OLNE_BENCH_CACHE": str(own)}


def _shared(wanted: _Kept) -> Path | None:
    """A file from a shared folder, which is read-only; files that do not fit are ignored."""
    for path in (path for folder in folders_of_others() for path in wanted.candidates(folder)):
        with suppress(OSError):
            if not why_foreign(path) and path.name == wanted.name(path):
                return path
    return None


def _kept(wanted: _Kept) -> Path | None:
    """A kept file that is ours and unchanged; files that are not are removed."""
    for path in wanted.candidates(_folder()):
        try:
            wrong = why_foreign(path) or ("" if path.name == wanted.name(path) else "damaged")
            if not wrong:
                os.utime(path)  # for the order in which libraries are removed
                return path
        except FileNotFoundError:
            continue
        except OSError as error:
            wrong = f"unreadable ({error.strerror})"
        warn(f"{path} is {wrong}: compiled anew")
        path.unlink(missing_ok=True)
    return None


def _folder() -> Path:
    return kept_folder() or Path(_scratch_folder().name)


@lru_cache(maxsize=1)
def _scratch_folder() -> "tempfile.TemporaryDirectory[str]":
    """A temporary folder for this process, which compiles everything anew."""
    return tempfile.TemporaryDirectory(prefix="olne-bench-")


def _tidy(folder: Path, keep: Path) -> None:
    """Remove the least recently used libraries beyond the limit, and abandoned scratch folders."""
    for path in folder.glob(f"{_SCRATCH}*"):
        with suppress(FileNotFoundError):  # another process does the same
            if time.time() - path.stat().st_mtime > _ABANDONED:
                shutil.rmtree(path, ignore_errors=True)
    remove_oldest([*folder.glob("*.so"), *folder.glob("*.o")], SIZE_LIMIT, keep)
