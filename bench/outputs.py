"""Files that commands write: named well, never over something that exists."""

from pathlib import Path

from bench.errors import UserError


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
