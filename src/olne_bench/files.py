"""Files that are written: named well, written whole, users' own never overwritten."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from olne_bench.errors import UserError


def check_new_file(option: str, path: Path, suffixes: tuple[str, ...]) -> None:
    """Refuse a file that must not or cannot be written, before any work is done.

    Raises:
        UserError: on another suffix, a file that exists, or a folder that does not.
    """
    if path.suffix.lower() not in suffixes:
        raise UserError(f"{option} {path}: the name must end in {' or '.join(suffixes)}")
    if path.exists():
        raise UserError(f"{option} {path} exists already; remove it or name another file")
    if not path.parent.is_dir():
        raise UserError(f"{option} {path}: there is no folder {str(path.parent)!r}")


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A path to write to; the file takes its name, and its predecessor's place, once it is whole.

    So an interrupt or a full disk leaves the former file as it was.
    """
    unfinished = path.with_name(f".{path.name}.unfinished")
    try:
        yield unfinished
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)
