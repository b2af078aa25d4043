"""Check files to read; write files completely, and never overwrite a user's file."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from olne_bench.errors import UserError

#: Files that programs leave in a folder where they have looked.
_LEFT = (".DS_Store", ".directory", "Thumbs.db", "desktop.ini")


def check_input(kind: str, path: Path, most: int) -> None:
    """Refuse a file that cannot be read or is too large, before it is read."""
    with _told(f"{kind} {path} cannot be read"):
        if not path.is_file():
            folder = "; it is a folder" if path.is_dir() else ""
            raise UserError(f"no {kind} {str(path)!r}{folder}")
        size = path.stat().st_size
        if size > most:
            raise UserError(f"{kind} {path} has {size} bytes, at most {most} are read")
        path.open("rb").close()


def check_new_file(option: str, path: Path, suffixes: tuple[str, ...]) -> None:
    """Refuse a new file that must not or cannot be written, before any work is done."""
    if path.suffix.lower() not in suffixes:
        raise UserError(f"{option} {path}: the name must end in {' or '.join(suffixes)}")
    with _told(f"{option} {path} cannot be written"):
        if path.exists() or path.is_symlink():
            raise UserError(f"{option} {path} exists already; remove it or name another file")
        if not path.parent.is_dir():
            raise UserError(f"{option} {path}: there is no folder {str(path.parent)!r}")
        with TemporaryDirectory(dir=path.parent, prefix=".unfinished-"):
            pass  # only an attempt shows whether a folder can be written to


def check_folder(folder: Path, marks: tuple[str, ...], left: tuple[str, ...] = ()) -> None:
    """Refuse a folder to write to that holds files of others, before anything is written."""
    with _told(f"cannot write to {folder}"):
        if not folder.exists():
            return
        if not folder.is_dir():
            raise UserError(f"cannot write to {folder}: it is a file, a folder is needed")
        names = sorted(entry.name for entry in folder.iterdir())
    others = [name for name in names if name not in (*_LEFT, *left)]
    if others and not set(names) & set(marks):
        raise UserError(
            f"{folder} is not empty and has no {' or '.join(marks)}, so its files are not those of "
            f"a study ({others[0]!r} is one of {len(others)}); name a new folder or an empty one"
        )


def make_folder(folder: Path) -> None:
    """Make a folder, unless it is there; refuse one that cannot be written to."""
    with _told(f"cannot write to {folder}"):
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=folder, prefix=".unfinished-"):
            pass


@contextmanager
def whole_file(path: Path, *, new: bool = False) -> Iterator[Path]:
    """A temporary path to write to; when it is complete, it replaces the file at ``path``.

    An interrupt or a full disk leaves the former file unchanged. A ``new`` file replaces none, not
    even one that somebody wrote in the meantime.
    """
    with (
        _told(f"{path} cannot be written"),
        # A folder of its own: a name beside the file could be that of a user's file.
        TemporaryDirectory(dir=path.parent, prefix=".unfinished-") as made,
    ):
        unfinished = Path(made) / path.name
        yield unfinished
        if new and (path.exists() or path.is_symlink()):
            raise UserError(f"{path} cannot be written: it exists by now; name another file")
        unfinished.replace(path)


@contextmanager
def whole_folder(folder: Path) -> Iterator[Path]:
    """A temporary folder to write to; when it is complete, it comes to stand at ``folder``.

    There must be nothing, or an empty folder.
    """
    with _told(f"{folder} cannot be written"):
        folder.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=folder.parent, prefix=".unfinished-") as made:
            unfinished = Path(made) / folder.name
            unfinished.mkdir()
            yield unfinished
            unfinished.replace(folder)


@contextmanager
def _told(what: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        reason = os.strerror(error.errno) if error.errno else error  # pyarrow says more than that
        raise UserError(f"{what}: {reason}") from error
