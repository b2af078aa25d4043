"""Compiles ``elimination.c`` for one structure of game and calls it through ``ctypes``.

Algorithms that build on it may have C code of their own, which is compiled along with it (see
``extension``).

CasADi writes the stage functions as C. Their numeric constants are moved into run-time tables, so
that games which differ in goals, targets or dt share one compiled library, for any horizon
(``games.compiler`` keeps them). Where native code does not work, ``games.elimination`` does the
same in NumPy.

No array crosses the boundary unchecked: every method brings its arguments to aligned, dense float64
and compares their shapes; ``numpy.ctypeslib.ndpointer`` then holds the C signatures to it.
"""

import ctypes
import re
from collections.abc import Sequence
from functools import lru_cache
from importlib.resources import files

import casadi as ca
import numpy as np
from numpy.ctypeslib import ndpointer

from olne_bench.games import compiler
from olne_bench.games.elimination import SMALLEST_STEP, Elimination
from olne_bench.games.game import Game
from olne_bench.games.lanes import LaneKeeping
from olne_bench.games.observation import VIEWS, View
from olne_bench.games.stage_functions import Pattern, StageFunctions, stage_functions

#: Around code that is not worth the compiler's time.
_UNOPTIMISED = '#pragma GCC push_options\n#pragma GCC optimize("O0")\n{}\n#pragma GCC pop_options\n'
_LARGEST_INT = 2**31 - 1
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
    if not once:
        source, constants = _source(stages, _UNOPTIMISED if rare else "{}")
        library = compiler.load(source + extension)
        if library is not None:
            return NativeElimination(stages, game.horizon, _declare(library), constants)
    return Elimination(stages, game.horizon)


def backend() -> str:
    """What computes here: ``native: `` and its compiler, or ``numpy``; see ``games.compiler``."""
    return compiler.backend()


def _has_own_structure(game: Game) -> bool:
    """Whether hardly another game shares this one's structure: routes differ from draw to draw.

    Compiling takes seconds there, and solving the forward game in NumPy one. The inverse problem is
    solved often enough to be worth it, if the stage functions, a megabyte of straight-line code,
    are not optimised: that takes 3 s in place of 20.
    """
    terms = (feature for player in game.players for feature in player.task)
    return any(isinstance(term, LaneKeeping) for term in terms)


class Work(ctypes.Structure):
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


def vector_pointer(ndim: int, *, output: bool = False) -> type:
    """The C type of a pointer to a dense float64 array; ``output`` where the function writes."""
    if output:
        return ndpointer(dtype=np.float64, ndim=ndim, flags=("C", "ALIGNED", "WRITEABLE"))
    return ndpointer(dtype=np.float64, ndim=ndim, flags=("C", "ALIGNED"))


class NativeElimination(Elimination):
    """``Elimination`` with its numerical work in C; same methods, same numbers.

    Attributes:
        library: the compiled code.
        work: the work space, which its functions take by reference as their first argument.

    All methods raise ValueError on an array of the wrong shape.
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
        self._shape = (horizon, size)
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
        self.work = Work(
            horizon,
            **{name: array.ctypes.data for name, array in self._arrays.items()},
        )
        super().__init__(stages, horizon)

    def set_observations(self, y: np.ndarray, noise_scale: np.ndarray | float = 1.0) -> None:
        super().set_observations(y, noise_scale)
        # C keeps these two pointers; the attributes keep the arrays alive.
        shape = (self.horizon, self.stages.num_samples)
        self._samples = dense("samples", self._samples, shape)
        self._precision = dense("precision", self._precision, shape)
        self.work.samples = self._samples.ctypes.data
        self.work.precision = self._precision.ctypes.data

    def evaluate(self, z: np.ndarray, theta: np.ndarray) -> np.ndarray:
        residual = np.empty(self._shape)
        self.library.evaluate(self.work, self._rows("z", z), self._weights(theta), residual)
        return residual

    def observation_loss(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        gradient = np.empty(self._shape)
        loss = self.library.observation_loss(self.work, self._rows("z", z), gradient)
        return loss, gradient

    def linearise(self, z: np.ndarray, theta: np.ndarray) -> bool:
        status = self.library.linearise(self.work, self._rows("z", z), self._weights(theta))
        return bool(status == 0)

    def solve(self, right: np.ndarray, *, transposed: bool = False) -> np.ndarray:
        out = np.empty(self._shape)
        self.library.solve(self.work, int(transposed), self._rows("right", right), out)
        return out

    def sensitivities(self) -> np.ndarray:
        self.library.sensitivities(self.work)
        return self._arrays["Z"]

    def reduced_hessian(
        self, z: np.ndarray, theta: np.ndarray, multipliers: np.ndarray
    ) -> np.ndarray:
        W = np.empty((self._columns, self._columns))
        self.library.reduced_hessian(
            self.work,
            self._rows("z", z),
            self._weights(theta),
            self._rows("multipliers", multipliers),
            W,
        )
        return W

    def trajectory_metric(self) -> np.ndarray:
        metric = np.empty((self._columns, self._columns))
        self.library.trajectory_metric(self.work, metric)
        return metric

    def hessian_product(self, d: np.ndarray, d_theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        out, out_theta = np.empty(self._shape), np.empty(self.stages.num_weights)
        d, d_theta = self._rows("d", d), self._weights(d_theta)
        self.library.hessian_product(self.work, d, d_theta, out, out_theta)
        return out, out_theta

    def reduce(self, g: np.ndarray) -> np.ndarray:
        out = np.empty(self._columns)
        self.library.reduce(self.work, self._rows("g", g), out)
        return out

    def expand(self, d: np.ndarray) -> np.ndarray:
        out = np.zeros(self._shape)
        self.library.expand(self.work, dense("d", d, (self._columns,)), out)
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
        count = len(z)
        points = dense("z", z, (count, *self._shape))
        if not points.flags.writeable:
            raise ValueError("z is overwritten, but cannot be written to")
        theta = dense("theta", theta, (count, self.stages.num_weights))
        residuals, iterations = np.empty(count), np.empty(count, dtype=np.int32)
        self.library.newton(
            self.work,
            count,
            points,
            theta,
            tolerance,
            min(max_iterations, _LARGEST_INT),
            limit,
            residuals,
            iterations,
        )
        if points is not z:
            z[:] = points
        return residuals, iterations

    def _rows(self, name: str, array: np.ndarray) -> np.ndarray:
        return dense(name, array, self._shape)

    def _weights(self, theta: np.ndarray) -> np.ndarray:
        return dense("theta", theta, (self.stages.num_weights,))


def dense(name: str, array: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """The array as C reads it: float64, contiguous, aligned; not copied if it is so already.

    Raises:
        ValueError: if the shape is not the expected one.
    """
    array = np.require(array, np.float64, ("C_CONTIGUOUS", "ALIGNED"))
    if array.shape != shape:
        raise ValueError(f"{name} has the shape {array.shape}, expected {shape}")
    return array


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


def _declare(library: ctypes.CDLL) -> ctypes.CDLL:
    """Argument types of the functions of ``elimination.c``."""
    work, real, integer = ctypes.POINTER(Work), ctypes.c_double, ctypes.c_int
    vector, rows = vector_pointer(1), vector_pointer(2)
    new_vector, new_rows, new_batch = (vector_pointer(ndim, output=True) for ndim in (1, 2, 3))
    counts = ndpointer(dtype=np.int32, ndim=1, flags=("C_CONTIGUOUS", "WRITEABLE"))
    signatures: dict[str, tuple[object, list[object]]] = {
        "evaluate": (None, [work, rows, vector, new_rows]),
        "observation_loss": (real, [work, rows, new_rows]),
        "linearise": (integer, [work, rows, vector]),
        "solve": (None, [work, integer, rows, new_rows]),
        "sensitivities": (None, [work]),
        "reduced_hessian": (None, [work, rows, vector, rows, new_rows]),
        "trajectory_metric": (None, [work, new_rows]),
        "hessian_product": (None, [work, rows, vector, new_rows, new_vector]),
        "reduce": (None, [work, rows, new_vector]),
        "expand": (None, [work, vector, new_rows]),
        "newton": (
            None,
            [work, integer, new_batch, rows, real, integer, real, new_vector, counts],
        ),
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library
