"""Write files: check their names, write them completely, and never overwrite a user's file."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from olne_bench.errors import UserError


def check_new_file(option: str, path: Path, suffixes: tuple[str, ...]) -> None:
    """Refuse a new file that must not or cannot be written, before any work is done.

    Raises:
        UserError: on another suffix, a file that exists, or a folder that does not exist.
    """
    if path.suffix.lower() not in suffixes:
        raise UserError(f"{option} {path}: the name must end in {' or '.join(suffixes)}")
    if path.exists():
        raise UserError(f"{option} {path} exists already; remove it or name another file")
    if not path.parent.is_dir():
        raise UserError(f"{option} {path}: there is no folder {str(path.parent)!r}")


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A temporary path to write to; when it is complete, it replaces the file at ``path``.

    An interrupt or a full disk leaves the former file unchanged.
    """
    unfinished = path.with_name(f".{path.name}.unfinished")
    try:
        yield unfinished
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)
