"""Files of a submission, which may be anything: looked at before they are read.

Sizes, kinds and numbers are known without opening a file. A link, a pipe or a device is no part of
a submission, and a file is read up to the size that it may have.
"""

import hashlib
import os
import stat
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

from olne_bench.bench.plan.values import shown
from olne_bench.errors import UserError

#: Largest size of all files of a submission together [bytes]: the repository keeps them forever.
MOST_BYTES = 10_000_000
#: Largest number of files of a submission.
MOST_FILES = 500
#: Longest path of a file in a submission [characters].
_LONGEST = 250


def check_place(place: str, folder: Path) -> None:
    """Refuse a path that leads out of a submission, is too long or not printable (UserError)."""
    parts = PurePosixPath(place).parts
    usual = place.isprintable() and "\\" not in place and PurePosixPath(place).as_posix() == place
    inside = bool(parts) and not place.startswith("/") and ".." not in parts
    if not (usual and inside and len(place) <= _LONGEST):
        raise UserError(f"{folder}: {shown(place)} is not a file within a submission")


def check_folder(folder: Path, listed: Iterable[str], manifest: str) -> None:
    """Refuse a folder that holds others than the listed usual files, or larger ones (UserError)."""
    wanted = {manifest, *listed}
    parents = {str(p) for place in wanted for p in PurePosixPath(place).parents}
    size = sum(_size(folder, place) for place in sorted(wanted))
    if size > MOST_BYTES:
        raise UserError(f"{folder}: its files have {size} bytes; at most {MOST_BYTES} are allowed")
    for parent in sorted(parents):
        with os.scandir(folder / parent) as entries:
            for entry in entries:
                place = (PurePosixPath(parent) / entry.name).as_posix()
                if place not in wanted and place not in parents:
                    raise UserError(
                        f"{folder}: {shown(place)} is not listed in {manifest}; remove it"
                    )


def _size(folder: Path, place: str) -> int:
    """Size of a usual file [bytes], none of whose folders is a link."""
    path = folder / place
    for step in PurePosixPath(place).parents:
        if step != PurePosixPath(".") and (folder / step).is_symlink():
            raise UserError(f"{folder}: {place!r} is not a file within a submission: a link")
    try:
        found = path.lstat()
    except OSError as error:
        raise UserError(f"{folder}: {place} is missing") from error
    if not stat.S_ISREG(found.st_mode):
        raise UserError(f"{folder}: {place!r} is not a file within a submission")
    return found.st_size


def read_file(folder: Path, place: str, most: int = MOST_BYTES) -> bytes:
    """The contents of a usual file of at most so many bytes."""
    size = _size(folder, place)
    if size > most:
        raise UserError(f"{folder}: {place} has {size} bytes; at most {most} are allowed")
    try:
        # What has become a link or a pipe by now is not waited for.
        handle = os.open(folder / place, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
        with os.fdopen(handle, "rb") as file:
            data = file.read(most + 1)
    except OSError as error:
        raise UserError(f"{folder}: {place} cannot be read: {error.strerror or error}") from error
    if len(data) > most:
        raise UserError(f"{folder}: {place} has more than {most} bytes")
    return data


def digest(data: bytes) -> str:
    """SHA-256 of the contents of a file."""
    return hashlib.sha256(data).hexdigest()
