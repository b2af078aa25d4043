"""Folders in which processes of one user keep for each other what is slow to make.

The first folder is that of compiled libraries: ``OLNE_BENCH_CACHE``, else
``$XDG_CACHE_HOME/olne-bench``, else ``~/.cache/olne-bench``. Files of other kinds are beside it, in
folders with its name and a suffix. A folder or file that belongs to another user, is writable by
others or is a link is not trusted; nor is a file that does not match its digest. Where a folder
holds too much, the least recently used files are removed; several processes may do so at once.
"""

import hashlib
import os
import stat
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

_WRITABLE_BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH
#: Environment variable with folders of libraries that a process may read but not write.
SHARED = "OLNE_BENCH_SHARED_CACHE"
_DIGEST = 32  # bytes of SHA-256


def warn(line: str) -> None:
    """Write one line to stderr."""
    print(f"olne-bench: {line}", file=sys.stderr, flush=True)


def why_foreign(path: Path) -> str:
    """Why a file or folder cannot be trusted; empty if it can."""
    found = path.lstat()
    if stat.S_ISLNK(found.st_mode):
        return "a link"
    if found.st_uid != os.getuid():
        return "owned by another user"
    if found.st_mode & _WRITABLE_BY_OTHERS:
        return "writable by others"
    return ""


def kept_folder() -> Path | None:
    """The first usable folder, created if it is missing; None if none is usable."""
    for folder in _folders():
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            wrong = why_foreign(folder.resolve())
            if not wrong and not os.access(folder, os.W_OK | os.X_OK):
                wrong = "not writable"
        except OSError as error:
            wrong = error.strerror or str(error)
        if not wrong:
            return folder
        _refuse(folder, wrong)
    return None


def folders_of_others() -> list[Path]:
    """Folders of libraries that this process may read but not write."""
    return [Path(one) for one in os.environ.get(SHARED, "").split(os.pathsep) if one]


def _folders() -> Iterator[Path]:
    if chosen := os.environ.get("OLNE_BENCH_CACHE"):
        yield Path(chosen)
    if home := os.environ.get("XDG_CACHE_HOME"):
        yield Path(home, "olne-bench")
    with suppress(RuntimeError):  # a user without a home
        yield Path.home() / ".cache" / "olne-bench"


@lru_cache(maxsize=8)
def _refuse(folder: Path, wrong: str) -> None:
    warn(f"the cache folder {folder} is not used: {wrong}")


def remove_oldest(files: Iterable[Path], most_bytes: int, keep: Path) -> None:
    """Remove the least recently used files while all of them are larger than a limit."""
    found = []
    for path in files:
        with suppress(FileNotFoundError):
            known = path.stat()
            found.append((known.st_mtime, known.st_size, path))
    total = sum(size for _, size, _ in found)
    for _, size, path in sorted(found):
        if total > most_bytes and path != keep:
            path.unlink(missing_ok=True)
            total -= size


def sealed(content: bytes) -> bytes:
    """The content after its digest."""
    return hashlib.sha256(content).digest() + content


def unsealed(data: bytes) -> bytes | None:
    """The content of what was sealed; None if it is damaged."""
    digest, content = data[:_DIGEST], data[_DIGEST:]
    return content if content and hashlib.sha256(content).digest() == digest else None


@dataclass(frozen=True)
class KeptFiles:
    """One kind of kept files."""

    suffix: str
    most_bytes: int
    #: Whether processes that may only read the folders of others look there, too.
    shared: bool = False

    @property
    def folder(self) -> Path | None:
        """The folder, whether or not it exists; None if nothing can be kept."""
        libraries = kept_folder()
        return libraries and self._beside(libraries)

    def read(self, name: str) -> bytes | None:
        """The content of a file; None if it is missing or cannot be trusted."""
        for folder in filter(None, (self.folder, *self.shared_folders)):
            with suppress(OSError):
                if not (why_foreign(folder / name) or why_foreign(folder)):
                    data = (folder / name).read_bytes()
                    with suppress(OSError):
                        os.utime(folder / name)  # for the order in which files are removed
                    return unsealed(data)
        return None

    @property
    def shared_folders(self) -> list[Path]:
        """Folders of others, from which this process may only read."""
        return [self._beside(folder) for folder in folders_of_others()] if self.shared else []

    def _beside(self, folder: Path) -> Path:
        return folder.with_name(f"{folder.name}{self.suffix}")

    def write(self, name: str, content: bytes) -> None:
        """Keep a content; if the file cannot be written, it is not kept."""
        folder = self.folder
        with suppress(OSError):
            if folder is None:
                return
            folder.mkdir(mode=0o700, exist_ok=True)
            if why_foreign(folder):
                return
            # Written to another file and then moved, so that several processes can write at once.
            with tempfile.NamedTemporaryFile(dir=folder, delete=False) as file:
                file.write(sealed(content))
            path = Path(file.name).replace(folder / name)
            remove_oldest(folder.iterdir(), self.most_bytes, keep=path)
