"""Equilibria of draws kept on disk, so that a second reset of a seed does not solve again.

Only worlds that draw a built-in scenario by its name use kept equilibria (``keeping``). The referee
of a benchmark gives its worlds finished scenarios, so the truth of a run is never kept. Estimators
cannot read the folder in any case (``bench.process.sandbox``).

The name of a file is a digest of all that determines the result: the game, the weights, the start,
this package's code, the versions of the libraries and the type of machine. The file holds the exact
arrays after a digest of its content. A file that is damaged, owned by another user or writable by
others is not read. If there are more than ``MOST_FILES``, the least recently used ones are removed.

``OLNE_BENCH_DRAWS=0`` switches this off. The folder is beside that of compiled libraries
(``games.compiled.compiler``) and has the same name with the suffix ``-draws``.

The draws of a suite may also come in one file (``envs.solved.draws_file``), for the truths of a run
and of its report (``travelling``).
"""

import hashlib
import io
import os
import platform
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import fields, is_dataclass
from functools import lru_cache
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

from olne_bench.envs.solved.draws_file import Draws
from olne_bench.envs.solved.draws_folder import draws_folder
from olne_bench.errors import MALFORMED
from olne_bench.games.compiled.compiler import backend, why_foreign
from olne_bench.games.model.game import Game
from olne_bench.games.solve.olne import Certificate, Equilibrium, Gains

#: Largest number of files, of some ten kilobytes each.
MOST_FILES = 2000

_LIBRARIES = ("casadi", "numpy", "scipy", "highway-env", "olne-bench")
_PACKAGES = ("olne_bench.games", "olne_bench.envs")
_DIGEST = 32  # bytes of SHA-256
_keeping: ContextVar[bool] = ContextVar("keeping", default=False)
_travelling: ContextVar[Draws | None] = ContextVar("travelling", default=None)
_collecting: ContextVar[Draws | None] = ContextVar("collecting", default=None)


@contextmanager
def keeping(wanted: bool = True) -> Iterator[None]:
    """Within this context, equilibria are kept on disk and read from there, if wanted."""
    token = _keeping.set(wanted and os.environ.get("OLNE_BENCH_DRAWS", "1") != "0")
    try:
        yield
    finally:
        _keeping.reset(token)


@contextmanager
def travelling(draws: Draws | None) -> Iterator[None]:
    """Within this context, what the draws hold is not solved again; None has no effect."""
    token = _travelling.set(draws)
    try:
        yield
    finally:
        _travelling.reset(token)


@contextmanager
def collecting(draws: Draws) -> Iterator[None]:
    """Within this context, the draws note all games that are refused."""
    token = _collecting.set(draws)
    try:
        yield
    finally:
        _collecting.reset(token)


def travelled(game: Game, weights: np.ndarray, initial_state: np.ndarray) -> Equilibrium | None:
    """The equilibrium of a game among the draws that travel; None if it is not there.

    Raises:
        OtherDrawsError: if they hold another game's motion in its place.
    """
    draws = _travelling.get()
    return None if draws is None else draws.equilibrium(game, weights, initial_state)


def is_held(game: Game, weights: np.ndarray, initial_state: np.ndarray) -> bool:
    """Whether the draws that travel hold a game's motion, and so have accepted it."""
    draws = _travelling.get()
    return draws is not None and draws.holds(game, weights, initial_state)


def was_refused(game: Game, weights: np.ndarray, initial_state: np.ndarray) -> bool:
    """Whether a game was refused when the draws that travel were made."""
    draws = _travelling.get()
    return draws is not None and draws.is_refused(game, weights, initial_state)


def refuse(game: Game, weights: np.ndarray, initial_state: np.ndarray) -> None:
    """Note that a game is no truth."""
    draws = _collecting.get()
    if draws is not None:
        draws.refuse(game, weights, initial_state)


def file_of(game: Game, weights: bytes, initial_state: bytes) -> Path | None:
    """The file of a solved game; None if nothing is to be kept or the game cannot be described."""
    folder = draws_folder() if _keeping.get() else None
    if folder is None:
        return None
    try:
        told = _told(game)
    except TypeError:
        return None
    parts = (*_surroundings(), told, weights.hex(), initial_state.hex())
    return folder / f"{hashlib.sha256(repr(parts).encode()).hexdigest()}.npz"


def read(path: Path) -> Equilibrium | None:
    """Read a kept equilibrium; None if the file is missing or cannot be trusted."""
    with suppress(OSError, TypeError, *MALFORMED):
        if why_foreign(path) or why_foreign(path.parent):
            return None
        content = path.read_bytes()
        if hashlib.sha256(content[_DIGEST:]).digest() != content[:_DIGEST]:
            return None
        os.utime(path)  # for the order in which files are removed
        with np.load(io.BytesIO(content[_DIGEST:]), allow_pickle=False) as arrays:
            certificate = Certificate(
                arrays["costs"],
                float(arrays["tolerance"]),
                local=_gains(arrays, "local"),
                global_so_far=_gains(arrays, "far") if "far_gains" in arrays else None,
                violation=float(arrays["violation"]),
            )
            return Equilibrium(
                arrays["states"],
                arrays["controls"],
                arrays["costates"],
                float(arrays["residual"]),
                certificate,
                arrays["multipliers"],
                arrays["margins"],
            )
    return None


def _gains(arrays: Mapping[str, np.ndarray], name: str) -> Gains:
    return Gains(arrays[f"{name}_gains"], arrays[f"{name}_starts"], bool(arrays[f"{name}_passed"]))


def write(path: Path, solved: Equilibrium) -> None:
    """Keep an equilibrium; if the file cannot be written, it is not kept."""
    buffer = io.BytesIO()
    certificate = solved.certificate
    searches = {"local": certificate.local, "far": certificate.global_so_far}
    evidence: dict[str, Any] = {}
    for name, gains in searches.items():
        if gains is not None:
            evidence[f"{name}_gains"], evidence[f"{name}_starts"] = gains.values, gains.starts
            evidence[f"{name}_passed"] = np.array(gains.passed)
    np.savez(
        buffer,
        states=solved.states,
        controls=solved.controls,
        costates=solved.costates,
        residual=solved.residual,
        costs=certificate.costs,
        tolerance=certificate.tolerance,
        violation=certificate.violation,
        multipliers=solved.multipliers,
        margins=solved.margins,
        **evidence,
    )
    content = buffer.getvalue()
    with suppress(OSError):
        path.parent.mkdir(mode=0o700, exist_ok=True)
        if why_foreign(path.parent):
            return
        # Written to another file and then moved, so that several processes can write at once.
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
            file.write(hashlib.sha256(content).digest() + content)
        Path(file.name).replace(path)
        _tidy(path.parent)


def _tidy(folder: Path) -> None:
    """Remove the least recently used files beyond the limit."""
    kept = []
    for path in folder.iterdir():
        with suppress(FileNotFoundError):  # another process may remove some as well
            kept.append((path.stat().st_mtime, path))
    for _, path in sorted(kept)[: max(0, len(kept) - MOST_FILES)]:
        path.unlink(missing_ok=True)


@lru_cache(maxsize=1)
def _surroundings() -> tuple[str, ...]:
    """All that determines a result besides the game."""
    code = hashlib.sha256()
    for package in _PACKAGES:
        for path in _sources(Path(str(files(package)))):
            code.update(path.name.encode() + path.read_bytes())
    libraries = [f"{name} {version(name)}" for name in _LIBRARIES]
    return (code.hexdigest(), *libraries, backend(), platform.machine(), platform.python_version())


def _sources(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.suffix in (".py", ".c"))


def _told(value: Any) -> str:
    """A text that differs for different games: fields of dataclasses, names of functions.

    Raises:
        TypeError: on a value of another kind.
    """
    if is_dataclass(value) and not isinstance(value, type):
        inner = ", ".join(f"{f.name}={_told(getattr(value, f.name))}" for f in fields(value))
        return f"{type(value).__module__}.{type(value).__qualname__}({inner})"
    if isinstance(value, tuple):
        return f"({', '.join(map(_told, value))})"
    if isinstance(value, FunctionType):
        return f"{value.__module__}.{value.__qualname__}"
    if value is None or isinstance(value, bool | int | float | str):
        return repr(value)
    raise TypeError(f"no text for a {type(value).__name__}")
