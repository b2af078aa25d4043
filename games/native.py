"""Compiles ``elimination.c`` for one structure of game and calls it through ``ctypes``.

Algorithms that build on it may have C code of their own, which is compiled along with it (see
``extension``).

CasADi writes the stage functions as C. Their numeric constants are moved into run-time tables, so
that games which differ in goals, targets or dt share one compiled library, for any horizon. The
library is kept in the user's cache folder under a hash of its source, flags and processor. Where
there is no compiler, ``games.elimination`` does the same in NumPy.

Environment: ``CC`` names the compiler (default ``cc``); ``OLNE_BENCH_CACHE`` the cache folder
(default ``~/.cache/olne-bench``); ``OLNE_BENCH_NATIVE=0`` switches native code off.
"""

import ctypes
import hashlib
import logging
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from functools import lru_cache
from importlib.resources import files
from pathlib import Path

import casadi as ca
import numpy as np

from olne_bench.games.elimination import SMALLEST_STEP, Elimination
from olne_bench.games.game import Game
from olne_bench.games.lanes import LaneKeeping
from olne_bench.games.observation import VIEWS, View
from olne_bench.games.stage_functions import Pattern, StageFunctions, stage_functions

_FLAGS = (
    *("-O3", "-march=native", "-funroll-loops", "-fPIC", "-shared", "-fvisibility=hidden"),
    # Sums may be taken in another order; NaN and infinity keep their meaning.
    *("-fno-math-errno", "-fno-trapping-math", "-fno-signed-zeros", "-fassociative-math"),
)
#: Around code that is not worth the compiler's time.
_UNOPTIMISED = '#pragma GCC push_options\n#pragma GCC optimize("O0")\n{}\n#pragma GCC pop_options\n'
_LOG = logging.getLogger(__name__)
_CONSTANT = re.compile(r"^(\s*a\d+=)(-?\d+\.\d*(?:e[+-]?\d+)?);$", re.MULTILINE)


@lru_cache(maxsize=64)
def elimination(game: Game, view: View | None = None, extension: str = "") -> Elimination:
    """The fastest elimination that works here, built or fetched.

    Args:
        game: the game.
        view: the observation model, where the inverse problem is meant.
        extension: C source that is compiled behind ``elimination.c``. The caller declares its
            functions on ``NativeElimination.library`` and passes ``NativeElimination.pointer``.
    """
    stages = stage_functions(game, view or VIEWS["full"])
    rare = _has_own_structure(game)
    once = view is None and rare
    if os.environ.get("OLNE_BENCH_NATIVE", "1") != "0" and not once:
        source, constants = _source(stages, _UNOPTIMISED if rare else "{}")
        library = _library(source + extension)
        if library is not None:
            return NativeElimination(stages, game.horizon, library, constants)
    return Elimination(stages, game.horizon)


def _has_own_structure(game: Game) -> bool:
    """Whether hardly another game shares this one's structure: routes differ from draw to draw.

    Compiling takes seconds there, and solving the forward game in NumPy one. The inverse problem is
    solved often enough to be worth it, if the stage functions, a megabyte of straight-line code,
    are not optimised: that takes 3 s in place of 20.
    """
    terms = (feature for player in game.players for feature in player.task)
    return any(isinstance(term, LaneKeeping) for term in terms)


class _Work(ctypes.Structure):
    """Mirrors ``Work`` of ``elimination.c``."""

    _fields_ = (
        ("horizon", ctypes.c_int),
        *[
            (name, ctypes.c_void_p)
            for name in (
                *("constants", "samples", "precision", "blocks", "curvature"),
                *("V", "M", "K", "S", "L", "Z", "scratch"),
            )
        ],
    )


class NativeElimination(Elimination):
    """``Elimination`` with its numerical work in C; same methods, same numbers.

    Attributes:
        library: the compiled code.
        pointer: address of the work space, the first argument of its functions.
    """

    def __init__(
        self,
        stages: StageFunctions,
        horizon: int,
        library: ctypes.CDLL,
        constants: np.ndarray,
    ) -> None:
        self.library = library
        nx, nu, size = stages.num_states, stages.num_controls, stages.size
        self._columns = nx + stages.num_weights
        block_values = sum(pattern.size for pattern in stages.blocks)
        curvature_values = max(stages.curvature.size, stages.final_curvature.size)
        self._arrays = {
            "constants": constants,
            "blocks": np.zeros((horizon, block_values)),
            "curvature": np.zeros((horizon, curvature_values)),
            "V": np.zeros((horizon, nx, nx)),
            "M": np.zeros((horizon, nu, nu)),
            "K": np.zeros((horizon, nu, nx)),
            "S": np.zeros((horizon, nu, nx)),
            "L": np.zeros((horizon, nx, nu)),
            "Z": np.zeros((horizon, size, self._columns)),
            "scratch": np.zeros((4, horizon, size)),
        }
        self._work = _Work(
            horizon,
            **{name: _address(array) for name, array in self._arrays.items()},
        )
        self.pointer = ctypes.addressof(self._work)
        super().__init__(stages, horizon)

    def set_observations(self, y: np.ndarray, noise_scale: np.ndarray | float = 1.0) -> None:
        super().set_observations(y, noise_scale)
        self._work.samples = _address(self._samples)
        self._work.precision = _address(self._precision)

    def evaluate(self, z: np.ndarray, theta: np.ndarray) -> np.ndarray:
        z, theta = _dense(z), _dense(theta)
        residual = np.empty_like(z)
        self.library.evaluate(self.pointer, _address(z), _address(theta), _address(residual))
        return residual

    def observation_loss(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        z = _dense(z)
        gradient = np.empty_like(z)
        loss = self.library.observation_loss(self.pointer, _address(z), _address(gradient))
        return loss, gradient

    def linearise(self, z: np.ndarray, theta: np.ndarray) -> bool:
        z, theta = _dense(z), _dense(theta)
        return self.library.linearise(self.pointer, _address(z), _address(theta)) == 0

    def solve(self, right: np.ndarray, *, transposed: bool = False) -> np.ndarray:
        right = _dense(right)
        out = np.empty_like(right)
        self.library.solve(self.pointer, int(transposed), _address(right), _address(out))
        return out

    def sensitivities(self) -> np.ndarray:
        self.library.sensitivities(self.pointer)
        return self._arrays["Z"]

    def reduced_hessian(
        self, z: np.ndarray, theta: np.ndarray, multipliers: np.ndarray
    ) -> np.ndarray:
        z, theta, multipliers = _dense(z), _dense(theta), _dense(multipliers)
        W = np.empty((self._columns, self._columns))
        self.library.reduced_hessian(
            self.pointer, _address(z), _address(theta), _address(multipliers), _address(W)
        )
        return W

    def trajectory_metric(self) -> np.ndarray:
        metric = np.empty((self._columns, self._columns))
        self.library.trajectory_metric(self.pointer, _address(metric))
        return metric

    def hessian_product(self, d: np.ndarray, d_theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        d, d_theta = _dense(d), _dense(d_theta)
        out, out_theta = np.empty_like(d), np.empty_like(d_theta)
        self.library.hessian_product(
            self.pointer, _address(d), _address(d_theta), _address(out), _address(out_theta)
        )
        return out, out_theta

    def reduce(self, g: np.ndarray) -> np.ndarray:
        g = _dense(g)
        out = np.empty(self._columns)
        self.library.reduce(self.pointer, _address(g), _address(out))
        return out

    def expand(self, d: np.ndarray) -> np.ndarray:
        d = _dense(d)
        out = np.zeros((self.horizon, self.stages.size))
        self.library.expand(self.pointer, _address(d), _address(out))
        return out

    def newton(
        self,
        z: np.ndarray,
        theta: np.ndarray,
        *,
        tolerance: float,
        max_iterations: int,
        limit: float,
    ) -> tuple[np.ndarray, np.ndarray]:
        points, theta = _dense(z), _dense(theta)
        residuals, iterations = np.empty(len(z)), np.empty(len(z), dtype=np.int32)
        self.library.newton(
            self.pointer,
            len(z),
            _address(points),
            _address(theta),
            tolerance,
            max_iterations,
            limit,
            _address(residuals),
            _address(iterations),
        )
        if points is not z:
            z[:] = points
        return residuals, iterations


def _dense(array: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(array, dtype=np.float64)


def _address(array: np.ndarray) -> int:
    return array.__array_interface__["data"][0]


def _source(stages: StageFunctions, around: str = "{}") -> tuple[str, np.ndarray]:
    """The C source of a game's structure, and the table of constants of its stage functions.

    Args:
        stages: stage functions of the game.
        around: what to put around their code.
    """
    functions, constants = _functions_source(stages.functions)
    definitions, offset = [], 0
    for pattern in stages.blocks:
        definitions.append(_pattern_source(f"PATTERN_{pattern.name}", pattern, offset))
        offset += pattern.size
    final_offset = 0
    for pattern in stages.final_blocks:
        definitions.append(_pattern_source(f"FINAL_{pattern.name}", pattern, final_offset))
        final_offset += pattern.size
    definitions.append(_pattern_source("PATTERN_H", stages.curvature, 0))
    definitions.append(_pattern_source("FINAL_H", stages.final_curvature, 0))
    sizes = {
        "NX": stages.num_states,
        "NU": stages.num_controls,
        "NT": stages.num_weights,
        "ND": stages.num_samples,
        "BLOCKS": offset,
        "CURVATURE": max(stages.curvature.size, stages.final_curvature.size),
        "SMALLEST_STEP": repr(SMALLEST_STEP),
    }
    head = "".join(f"#define {name} {value}\n" for name, value in sizes.items())
    body = files("olne_bench.games").joinpath("elimination.c").read_text()
    body = body.replace("PATTERN_DEFINITIONS", "\n".join(definitions))
    return head + around.replace("{}", functions) + body, constants


def _functions_source(functions: Sequence[ca.Function]) -> tuple[str, np.ndarray]:
    """CasADi's C code of the stage functions, their constants read from the work argument."""
    generator = ca.CodeGenerator("stages", {"casadi_int": "int"})
    for function in functions:
        generator.add(function)
    text = generator.dump()
    # Every argument and result is given, so the checks for absent ones go.
    text = re.sub(r"(arg\[\d+\])\? (\1\[\d+\]) : 0", r"\2", text)
    text = re.sub(r"if \(res\[\d+\]!=0\) ", "", text)
    table: list[float] = []

    def tabulate(match: re.Match[str]) -> str:
        table.append(float(match[2]))
        return f"{match[1]}w[{len(table) - 1}];"

    text = _CONSTANT.sub(tabulate, text)
    return f"#define CASADI_SYMBOL_EXPORT static\n{text}", np.array(table or [0.0])


def _pattern_source(name: str, pattern: Pattern, offset: int) -> str:
    rows = ", ".join(map(str, pattern.rows)) or "0"
    columns = ", ".join(map(str, pattern.columns)) or "0"
    return (
        f"static const Pattern {name} = {{{pattern.size}, {offset}, "
        f"(const int[]){{{rows}}}, (const int[]){{{columns}}}}};"
    )


@lru_cache(maxsize=64)
def _library(source: str) -> ctypes.CDLL | None:
    """Compile, or take from the cache, and load; None where that is not possible."""
    compiler = shutil.which(os.environ.get("CC", "cc"))
    if compiler is None:
        _LOG.info("no C compiler found: equilibria and joint estimates are computed in NumPy")
        return None
    try:
        path = _compile(compiler, source)
        return _declare(ctypes.CDLL(str(path)))
    except (OSError, subprocess.SubprocessError) as error:
        detail = getattr(error, "stderr", "") or str(error)
        _LOG.warning("native code is off, NumPy is used: %s", detail.strip().splitlines()[0])
        return None


def _compile(compiler: str, source: str) -> Path:
    target = _target(compiler)
    # Left to itself, gcc uses but half of the registers' width.
    flags = (*_FLAGS, "-mprefer-vector-width=512") if "__AVX512F__" in target else _FLAGS
    key = "\n".join([source, *flags, target])
    folder = Path(os.environ.get("OLNE_BENCH_CACHE", Path.home() / ".cache" / "olne-bench"))
    path = folder / f"elimination-{hashlib.sha256(key.encode()).hexdigest()[:20]}.so"
    if path.exists():
        return path
    folder.mkdir(parents=True, exist_ok=True)
    # Compiled aside and moved in one step, so that processes may race.
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        code, library = Path(scratch, "elimination.c"), Path(scratch, "elimination.so")
        code.write_text(source)
        command = [compiler, *flags, str(code), "-o", str(library), "-lm"]
        subprocess.run(command, check=True, capture_output=True, text=True, timeout=300)
        library.replace(path)
    return path


@lru_cache(maxsize=4)
def _target(compiler: str) -> str:
    """What the compiler is and what ``-march=native`` means on this processor."""
    command = [compiler, "-march=native", "-dM", "-E", "-x", "c", os.devnull]
    return subprocess.run(command, check=True, capture_output=True, text=True, timeout=60).stdout


def _declare(library: ctypes.CDLL) -> ctypes.CDLL:
    """Argument types of the functions of ``elimination.c``: all pointers but where stated."""
    pointer, real, integer = ctypes.c_void_p, ctypes.c_double, ctypes.c_int
    signatures: dict[str, tuple[object, list[object]]] = {
        "evaluate": (None, [pointer] * 4),
        "observation_loss": (real, [pointer] * 3),
        "linearise": (integer, [pointer] * 3),
        "solve": (None, [pointer, integer, pointer, pointer]),
        "sensitivities": (None, [pointer]),
        "reduced_hessian": (None, [pointer] * 5),
        "trajectory_metric": (None, [pointer] * 2),
        "hessian_product": (None, [pointer] * 5),
        "reduce": (None, [pointer] * 3),
        "expand": (None, [pointer] * 3),
        "newton": (
            None,
            [
                *(pointer, integer, pointer, pointer, real),
                *(integer, real, pointer, pointer),
            ],
        ),
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library
