"""Draws at hand: those of a suite, which travel, and those that a user has played in a world.

Only worlds that draw a built-in scenario by its name keep equilibria (``keeping``), for a second
reset of a seed; the truth of a run is never kept. Estimators cannot read the folder in any case
(``bench.process.sandbox``). ``OLNE_BENCH_DRAWS=0`` switches this off.

A kept file is a file of draws with one draw (``envs.solved.draws_file``). Its name is a digest of
all that determines the result: the game, the weights, the start, this package's code, the versions
of the libraries and the type of machine. The draws of a suite serve the truths of a run and of its
report (``travelling``).
"""

import hashlib
import os
import platform
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from contextvars import ContextVar
from dataclasses import fields, is_dataclass
from functools import lru_cache
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from types import FunctionType
from typing import Any, TypeVar

import numpy as np

from olne_bench.envs.solved import DRAWS_SUFFIX, KEPT_DRAWS
from olne_bench.envs.solved.draws_file import Draws, OtherDrawsError, packed, unpacked
from olne_bench.games.compiled.compiler import backend
from olne_bench.games.model.game import Game
from olne_bench.games.solve.olne import Equilibrium

T = TypeVar("T")
_LIBRARIES = ("casadi", "numpy", "scipy", "highway-env", "olne-bench")
_PACKAGES = ("olne_bench.games", "olne_bench.envs")
_keeping: ContextVar[bool] = ContextVar("keeping", default=False)
_travelling: ContextVar[Draws | None] = ContextVar("travelling", default=None)
_collecting: ContextVar[Draws | None] = ContextVar("collecting", default=None)


def keeping(wanted: bool = True) -> AbstractContextManager[None]:
    """Within this context, equilibria are kept on disk and read from there, if wanted."""
    return _set(_keeping, wanted and os.environ.get("OLNE_BENCH_DRAWS", "1") != "0")


def travelling(draws: Draws | None) -> AbstractContextManager[None]:
    """Within this context, what the draws hold is not solved again; None has no effect."""
    return _set(_travelling, draws)


def collecting(draws: Draws) -> AbstractContextManager[None]:
    """Within this context, the draws note all games that are refused."""
    return _set(_collecting, draws)


@contextmanager
def _set(variable: ContextVar[T], value: T) -> Iterator[None]:
    token = variable.set(value)
    try:
        yield
    finally:
        variable.reset(token)


def travelled(game: Game, weights: np.ndarray, initial_state: np.ndarray) -> Equilibrium | None:
    """The equilibrium of a game among draws that travel, or None; OtherDrawsError if it differs."""
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


def name_of(game: Game, weights: np.ndarray, initial_state: np.ndarray) -> str | None:
    """The name of a solved game's file; None if none is to be kept, or the game has no text."""
    if not _keeping.get() or game.constraints:
        return None
    try:
        told = _told(game)
    except TypeError:
        return None
    parts = (*_surroundings(), told, weights.tobytes().hex(), initial_state.tobytes().hex())
    return f"{hashlib.sha256(repr(parts).encode()).hexdigest()}{DRAWS_SUFFIX}"


def read(
    name: str, game: Game, weights: np.ndarray, initial_state: np.ndarray
) -> Equilibrium | None:
    """A kept equilibrium; None if the file is missing or cannot be trusted."""
    content = KEPT_DRAWS.read(name)
    with suppress(OtherDrawsError):
        if content is not None:
            return unpacked(content, name).equilibrium(game, weights, initial_state)
    return None


def write(name: str, game: Game, weights: np.ndarray, solved: Equilibrium) -> None:
    """Keep an equilibrium; one that is not certified, and so no truth, is not kept."""
    if solved.certificate.passed:
        draws = Draws()
        draws.add(game, weights, solved)
        KEPT_DRAWS.write(name, packed(draws))


@lru_cache(maxsize=1)
def _surroundings() -> tuple[str, ...]:
    """All that determines a result besides the game."""
    code = hashlib.sha256()
    for package in _PACKAGES:
        for path in sorted(Path(str(files(package))).rglob("*")):
            if path.suffix in (".py", ".c"):
                code.update(path.name.encode() + path.read_bytes())
    libraries = [f"{name} {version(name)}" for name in _LIBRARIES]
    return (code.hexdigest(), *libraries, backend(), platform.machine(), platform.python_version())


def _told(value: Any) -> str:
    """A text that differs for different games: fields of dataclasses, names of functions."""
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
