"""Compiles ``elimination.c`` for one structure of game and calls it through ``ctypes``.

Algorithms that build on it may have C code of their own, which is compiled along with it (see
``extension``).

CasADi writes the functions of one player and of a pair as C. The numbers of a game are arguments,
so that games which differ in goals, targets, lanes or dt share one compiled library, for any
horizon (``games.compiled.compiler`` keeps them). Where native code does not work,
``games.compiled.elimination`` does the same in NumPy.

No array crosses the boundary unchecked: every method brings its arguments to aligned, dense float64
and compares their shapes; ``numpy.ctypeslib.ndpointer`` then holds the C signatures to it.
"""

import ctypes
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import lru_cache
from importlib.resources import files

import casadi as ca
import numpy as np
from numpy.ctypeslib import ndpointer

from olne_bench.games.compiled import compiler
from olne_bench.games.compiled.complementarity import COMPLEMENTARITY_FUNCTIONS
from olne_bench.games.compiled.constraint_functions import CONSTRAINT_FUNCTIONS
from olne_bench.games.compiled.elimination import ENOUGH, SMALLEST_STEP, Elimination
from olne_bench.games.compiled.stage_functions import FUNCTIONS, StageFunctions, stage_functions
from olne_bench.games.compiled.stage_patterns import Pattern
from olne_bench.games.model.constraints import described
from olne_bench.games.model.game import Game
from olne_bench.games.model.numbers import numbers_table, structure_and_numbers, view_and_numbers
from olne_bench.games.model.observation import VIEWS, View
from olne_bench.games.model.unknowns import at_means, unknowns_of

_LARGEST_INT = 2**31 - 1


@lru_cache(maxsize=64)
def elimination(game: Game, view: View = VIEWS["full"], extension: str = "") -> Elimination:
    """The fastest elimination that works here, built or fetched.

    Constraints of the game are equations (``games.compiled.complementarity``).

    Args:
        game: the game.
        view: the observation model, where the inverse problem is meant.
        extension: C source that is compiled behind ``elimination.c``. The caller declares its
            functions on ``NativeElimination.library`` and passes ``NativeElimination.pointer``.
    """
    return _compiled(game, view, extension, condensed=False)


def interior_elimination(game: Game, known: Game | None = None) -> Elimination:
    """The elimination of ``games.solve.interior``, with constraints condensed.

    Args:
        game: the game.
        known: the game with known constraints (``Game.with_known_constraints``), if the game
            leaves some unknown. All of them share one object, which holds the latest numbers.

    Raises:
        ValueError: if constraints have unknowns and nobody says what they are.
    """
    if known is None or known is game:
        for constraint in game.constraints:
            if unknowns := unknowns_of(constraint):
                names = ", ".join(unknown.name for unknown in unknowns)
                raise ValueError(f"{described(constraint)} has unknowns: {names}")
        return _interior_elimination(game)
    solver = _interior_elimination(game)
    solver.constraint_numbers[:] = numbers_table(known.constraints, known.dt)
    return solver


@lru_cache(maxsize=64)
def _interior_elimination(game: Game) -> Elimination:
    game = replace(game, constraints=at_means(game.constraints))
    return _compiled(game, VIEWS["full"], "", condensed=True)


def plain_elimination(
    game: Game, view: View = VIEWS["full"], *, condensed: bool = False
) -> Elimination:
    """The elimination in NumPy."""
    stages = stage_functions(game, view, condensed=condensed)
    return Elimination(stages, game.horizon, *_numbers(game, view))


def _compiled(game: Game, view: View, extension: str, *, condensed: bool) -> Elimination:
    stages = stage_functions(game, view, condensed=condensed)
    library = compiler.load(_source(stages) + extension)
    if library is None:
        return plain_elimination(game, view, condensed=condensed)
    return NativeElimination(stages, game.horizon, *_numbers(game, view), _declare(library))


def _numbers(game: Game, view: View) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The numbers of a game, of a view, and of the game's constraints."""
    structure, numbers = structure_and_numbers(game)
    own = numbers_table(game.constraints, game.dt)
    return numbers, view_and_numbers(view, structure.dynamics)[1], own


def backend() -> str:
    """What computes here: ``native: `` and its compiler, or ``numpy``."""
    return compiler.backend()


class Stop(IntEnum):
    """Where a best response stopped; mirrors ``respond`` of ``response.c``."""

    EARLY = 0
    STATIONARY = 1
    MINIMUM = 2


@dataclass(frozen=True)
class NativeResponses:
    """Responses of one player from B first plans.

    Attributes:
        controls: (B, T-1, m).
        costates: (B, T-1, n).
        costs: (B,) J^i.
        stops: (B,) ``Stop`` values.
        iterations: (B,) Newton steps.
    """

    controls: np.ndarray
    costates: np.ndarray
    costs: np.ndarray
    stops: np.ndarray
    iterations: np.ndarray


@dataclass(frozen=True)
class NativeInterior:
    """Where the interior point method ended; see ``games.solve.interior.InteriorSolution``."""

    z: np.ndarray
    multipliers: np.ndarray
    residual: float
    solved: bool
    iterations: int


class Work(ctypes.Structure):
    """Mirrors ``Work`` of ``elimination.c``."""

    _fields_ = (
        ("horizon", ctypes.c_int),
        *[
            (name, ctypes.c_void_p)
            for name in (
                *("numbers", "view_numbers", "constraint_numbers", "samples", "precision"),
                *("blocks", "curvature", "V", "M", "K", "S", "L", "G", "v", "Z", "squares"),
                *("parts", "scratch"),
            )
        ],
        ("shift", ctypes.c_double),
        ("enforced", ctypes.c_void_p),
        ("relaxation", ctypes.c_double),
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
        numbers: np.ndarray,
        view_numbers: np.ndarray,
        constraint_numbers: np.ndarray,
        library: ctypes.CDLL,
    ) -> None:
        self.library = library
        nx, nu, size = stages.num_states, stages.num_controls, stages.size
        self._columns = nx + stages.num_weights
        self._shape = (horizon, size)
        block_values = sum(pattern.size for pattern in stages.blocks)
        curvature_values = max(stages.curvature.size, stages.final_curvature.size)
        self._arrays = {
            "numbers": dense("numbers", numbers, (stages.num_players, numbers.shape[1])),
            "view_numbers": dense("view_numbers", view_numbers, (stages.loss.num_numbers,)),
            "constraint_numbers": dense(
                "constraint_numbers", constraint_numbers, constraint_numbers.shape
            ),
            "blocks": np.zeros((horizon, block_values)),
            "curvature": np.zeros((horizon, curvature_values)),
            "V": np.zeros((horizon, nx, nx)),
            "M": np.zeros((horizon, nu, nu)),
            "K": np.zeros((horizon, nu, nx)),
            "S": np.zeros((horizon, nu, nx)),
            "L": np.zeros((horizon, nx, nu)),
            "G": np.zeros((horizon, nu, self._columns)),
            "v": np.zeros((horizon, nx, stages.num_weights)),
            "Z": np.zeros((horizon, size, self._columns)),
            "squares": np.zeros((3, max(self._columns, nx + nu) ** 2)),
            "parts": np.zeros(nu * nu + (nx + 2 * nu) * self._columns),
            "scratch": np.zeros((4, horizon, size)),
        }
        self.work = Work(
            horizon,
            **{name: array.ctypes.data for name, array in self._arrays.items()},
        )
        super().__init__(stages, horizon, numbers, view_numbers, constraint_numbers)
        self._arrays["enforced"] = self.enforced.astype(float)
        self.work.enforced = self._arrays["enforced"].ctypes.data

    @property
    def relaxation(self) -> float:
        return float(self.work.relaxation)

    @relaxation.setter
    def relaxation(self, tau: float) -> None:
        self.work.relaxation = tau

    def step_margins(self, z: np.ndarray, theta: np.ndarray) -> np.ndarray:
        out = np.empty((self.horizon - 1, self.stages.num_multipliers))
        self.library.step_margins(self.work, self._rows("z", z), self._weights(theta), out)
        return out

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

    def linearise_condensed(
        self, z: np.ndarray, theta: np.ndarray, v: np.ndarray, sigma: np.ndarray, shift: float
    ) -> bool:
        status = self.library.linearise_condensed(
            self.work,
            self._rows("z", z),
            self._weights(theta),
            self._margins("v", v),
            self._margins("sigma", sigma),
            shift,
        )
        return bool(status == 0)

    def margins(self, z: np.ndarray) -> np.ndarray:
        out = np.empty((self.horizon, self.stages.num_margins))
        self.library.margins(self.work, self._rows("z", z), out)
        return out

    def push(self, z: np.ndarray, v: np.ndarray) -> np.ndarray:
        out = np.empty(self._shape)
        self.library.push(self.work, self._rows("z", z), self._margins("v", v), out)
        return out

    def change(self, z: np.ndarray, d: np.ndarray) -> np.ndarray:
        out = np.empty((self.horizon, self.stages.num_margins))
        self.library.change(self.work, self._rows("z", z), self._rows("d", d), out)
        return out

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
        factorised: bool = False,
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
            factorised,
            residuals,
            iterations,
        )
        if points is not z:
            z[:] = points
        return residuals, iterations

    def costs(self, z: np.ndarray, theta: np.ndarray) -> np.ndarray:
        found = np.empty(self.stages.num_players)
        self.library.costs(self.work, self._rows("z", z), self._weights(theta), found)
        return found

    def responses(
        self,
        player: int,
        plans: np.ndarray,
        z: np.ndarray,
        theta: np.ndarray,
        *,
        tolerance: float = 1e-12,
        max_iterations: int = 200,
    ) -> "NativeResponses":
        """Best responses of one player to the others' motion, from several first plans.

        Args:
            player: index i.
            plans: (B, T-1, m) controls to start from.
            z: (T, size) trajectory of everybody.
            theta: (N*K,).
            tolerance: stop where Newton's step promises less than this share of 1 + |J^i|.
            max_iterations: Newton steps for each plan at most.
        """
        stages, count, steps = self.stages, len(plans), self.horizon - 1
        sizes = [stages.own_controls, stages.num_states // stages.num_players]
        plans = dense("plans", plans, (count, steps, sizes[0])).copy()
        costates, found = np.zeros((count, steps, sizes[1])), np.empty(count)
        status, iterations = np.empty(count, dtype=np.int32), np.empty(count, dtype=np.int32)
        self.library.responses(
            self.work,
            player,
            count,
            self._rows("z", z),
            self._weights(theta),
            tolerance,
            max_iterations,
            plans,
            costates,
            found,
            status,
            iterations,
            np.empty(self.library.response_space(self.horizon)),
        )
        return NativeResponses(plans, costates, found, status, iterations)

    def respond_in_turn(
        self,
        z: np.ndarray,
        theta: np.ndarray,
        *,
        first: int = 0,
        damping: float = 1.0,
        settled: float,
        max_rounds: int,
        max_steps: int,
        tolerance: float = 1e-12,
        max_iterations: int = 200,
    ) -> np.ndarray:
        """Iterated best response from a feasible motion; see ``games.solve.iterated_response``.

        Args:
            z: (T, size) trajectory of everybody.
            theta: (N*K,).
            first: the player that responds before the others.
            damping: share of the way to its response that a player goes.
            settled: stop where no response differs by more from what the player had planned.
            max_rounds: rounds through all players.
            max_steps: Newton steps of all responses together, after which no round starts.
            tolerance: as in ``responses``.
            max_iterations: Newton steps for each response at most.

        Returns:
            The last motion (T, size), with costates of the last responses.
        """
        z = self._rows("z", z).copy()
        self.library.respond_in_turn(
            self.work,
            first,
            z,
            self._weights(theta),
            damping,
            settled,
            tolerance,
            max_iterations,
            max_rounds,
            max_steps,
            np.empty(self.library.response_space(self.horizon)),
        )
        return z

    def interior(
        self,
        options: tuple[float, ...],
        z: np.ndarray,
        theta: np.ndarray,
        *,
        coupled: bool,
        tau: float,
        relaxed: float,
        max_iterations: int,
    ) -> "NativeInterior":
        """``games.solve.interior.InteriorPoint.solve``; the options are those of ``interior.c``."""
        z, v = self._rows("z", z).copy(), np.zeros((self.horizon, self.stages.num_margins))
        residual, solved = np.zeros(1), np.zeros(1, dtype=np.int32)
        iterations = self.library.interior(
            self.work,
            np.array(options),
            self._weights(theta),
            self.enforced,
            int(coupled),
            tau,
            relaxed,
            max_iterations,
            z,
            v,
            residual,
            solved,
            np.empty(self.library.interior_space(self.horizon)),
        )
        return NativeInterior(z, v, float(residual[0]), bool(solved[0]), iterations)

    def _rows(self, name: str, array: np.ndarray) -> np.ndarray:
        return dense(name, array, self._shape)

    def _margins(self, name: str, array: np.ndarray) -> np.ndarray:
        return dense(name, array, (self.horizon, self.stages.num_margins))

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


@lru_cache(maxsize=64)
def _source(stages: StageFunctions) -> str:
    """The C source of a structure of games."""
    count, pairs = stages.num_players, stages.constraint_kinds
    equations = stages.complementarity_kinds
    block_values = [sum(p.size for p in blocks) for blocks in (stages.blocks, stages.final_blocks)]
    sizes = {
        "PLAYERS": count,
        "STATES": stages.num_states // count,
        "CONTROLS": stages.own_controls,
        "MULTIPLIERS": stages.num_multipliers,
        "WEIGHTS": stages.num_weights // count,
        "SAMPLES": stages.num_samples // count,
        "NUMBERS": max(kind.num_numbers for kind in stages.kinds),
        "BLOCKS": block_values[0],
        "FINAL_BLOCKS": block_values[1],
        "CURVATURE": max(stages.curvature.size, stages.final_curvature.size),
        "LOSS_HESSIAN": stages.loss.pattern.size,
        "NUM_TERMS": len(stages.terms),
        "MOST_VALUES": max(
            function.numel_out(0) for kind in stages.kinds for function in kind.functions.values()
        ),
        "NUM_CONSTRAINTS": len(stages.constraints),
        "MARGINS": stages.num_margins,
        "CONSTRAINT_NUMBERS": max(
            [pair[0].num_numbers for pair in pairs] + [kind.num_numbers for kind in equations],
            default=0,
        ),
        "NUM_EQUATIONS": len(stages.complementarities),
        "MOST_EQUATION": max(
            (kind.functions[name].numel_out(0) for kind in equations for name in kind.functions),
            default=1,
        ),
        "MOST_CONDENSED": max(
            (pair[0].functions["condensed"].numel_out(0) for pair in pairs), default=1
        ),
        "SMALLEST_STEP": repr(SMALLEST_STEP),
        "ENOUGH": repr(ENOUGH),
    }
    head = "".join(f"#define {name} {value}\n" for name, value in sizes.items())
    folder = files("olne_bench.games.compiled")
    names = ["elimination.c", "reduction.c", "response.c"]
    names += ["interior.c"] if stages.constraints else []
    body = "".join(folder.joinpath(name).read_text() for name in names)
    return head + _functions_source(stages) + body.replace("DEFINITIONS", _definitions(stages))


def _functions_source(stages: StageFunctions) -> str:
    """CasADi's C code of the terms' functions, ``term<kind>_<name>``, and of the loss."""
    generator = ca.CodeGenerator("stages", {"casadi_int": "int"})
    for index, kind in enumerate(stages.kinds):
        for name, function in kind.functions.items():
            arguments = function.sx_in()
            results = function.call(arguments)
            generator.add(ca.Function(f"term{index}_{name}", arguments, results))
    for index, pair in enumerate(stages.constraint_kinds):
        for last, functions in enumerate(pair):
            for name, function in functions.functions.items():
                arguments = function.sx_in()
                results = function.call(arguments)
                generator.add(ca.Function(f"constraint{index}_{last}_{name}", arguments, results))
    for index, equation in enumerate(stages.complementarity_kinds):
        for name, function in equation.functions.items():
            arguments = function.sx_in()
            results = function.call(arguments)
            generator.add(ca.Function(f"equation{index}_{name}", arguments, results))
    generator.add(stages.loss.value)
    generator.add(stages.loss.hessian)
    text = generator.dump()
    # Every argument and result is given, so the checks for absent ones go.
    text = re.sub(r"(arg\[\d+\])\? (\1\[\d+\]) : 0", r"\2", text)
    text = re.sub(r"if \(res\[\d+\]!=0\) ", "", text)
    return f"#define CASADI_SYMBOL_EXPORT static\n{text}"


def _definitions(stages: StageFunctions) -> str:
    """Patterns, kinds of terms and terms, as ``elimination.c`` needs them."""
    lines, offset, final_offset = [], 0, 0
    for pattern in stages.blocks:
        lines.append(_pattern_source(f"PATTERN_{pattern.name}", pattern, offset))
        offset += pattern.size
    for pattern in stages.final_blocks:
        lines.append(_pattern_source(f"FINAL_{pattern.name}", pattern, final_offset))
        final_offset += pattern.size
    lines.append(_pattern_source("PATTERN_H", stages.curvature, 0))
    lines.append(_pattern_source("FINAL_H", stages.final_curvature, 0))
    for k, name in enumerate(("LOSS_PLACES", "FINAL_LOSS_PLACES")):
        rows = ", ".join(_integers(places[k]) for places in stages.loss_indices)
        lines.append(f"static const int *const {name}[PLAYERS] = {{{rows}}};")
    kinds = []
    for index, kind in enumerate(stages.kinds):
        names = ", ".join(f"term{index}_{name}" for name in FUNCTIONS)
        outputs = ", ".join(str(kind.functions[name].numel_out(0)) for name in FUNCTIONS)
        own = ", ".join(_integers(kind.own_places(name)) for name in FUNCTIONS[:4])
        kinds.append(f"{{{{{names}}}, {{{outputs}}}, {{{own}}}}}")
    lines.append(f"static const Kind KINDS[] = {{{', '.join(kinds)}}};")
    terms = []
    for term in stages.terms:
        indices = ", ".join(_integers(places) for places in term.indices.values())
        head = f"KINDS + {term.kind}, {term.owner}, {len(term.players)}"
        terms.append(f"{{{head}, {_integers(term.players)}, {{{indices}}}}}")
    lines.append(f"static const Term TERMS[] = {{{', '.join(terms)}}};")
    owned: list[list[int]] = [[] for _ in range(stages.num_players)]
    for index, term in enumerate(stages.terms):
        owned[term.owner].append(index)
    lists = ", ".join(f"{{{len(own)}, {_integers(own)}}}" for own in owned)
    lines.append(f"static const TermsOf TERMS_OF[PLAYERS] = {{{lists}}};")
    lines += _constraint_definitions(stages)
    lines += _equation_definitions(stages)
    return "\n".join(lines)


def _constraint_definitions(stages: StageFunctions) -> list[str]:
    """Kinds of constraints and constraints; one that is not used where there are none."""
    kinds, constraints = [], []
    for index, pair in enumerate(stages.constraint_kinds):
        for last, functions in enumerate(pair):
            names = ", ".join(f"constraint{index}_{last}_{name}" for name in CONSTRAINT_FUNCTIONS)
            nonzeros = functions.functions["condensed"].numel_out(0)
            kinds.append(f"{{{{{names}}}, {functions.num_margins}, {nonzeros}}}")
    for place in stages.constraints:
        pair_names = f"CONSTRAINT_KINDS + {2 * place.kind}, CONSTRAINT_KINDS + {2 * place.kind + 1}"
        indices = ", ".join(_integers(places) for places in place.indices)
        players = f"{_integers(place.players)}, {len(place.players)}, {place.offset}"
        constraints.append(f"{{{{{pair_names}}}, {{{indices}}}, {players}}}")
    return [
        f"static const ConstraintKind CONSTRAINT_KINDS[] = {{{', '.join(kinds) or '{{0}}'}}};",
        f"static const Constraint ALL_CONSTRAINTS[] = {{{', '.join(constraints) or '{{0}}'}}};",
    ]


def _equation_definitions(stages: StageFunctions) -> list[str]:
    """Kinds of constraints that are equations, and these; one that is not used for none."""
    kinds, equations = [], []
    for index, kind in enumerate(stages.complementarity_kinds):
        names = ", ".join(f"equation{index}_{name}" for name in COMPLEMENTARITY_FUNCTIONS)
        sizes = [kind.functions[name].numel_out(0) for name in COMPLEMENTARITY_FUNCTIONS]
        kinds.append(f"{{{{{names}}}, {{{', '.join(map(str, sizes))}}}}}")
    for place in stages.complementarities:
        indices = ", ".join(
            _integers(place.indices[name]) for name in COMPLEMENTARITY_FUNCTIONS[:3]
        )
        head = f"EQUATION_KINDS + {place.kind}, {len(place.players)}, {place.offset}"
        lists = f"{_integers(place.players)}, {_integers(place.theta)}"
        equations.append(f"{{{head}, {len(place.theta)}, {lists}, {{{indices}}}}}")
    return [
        f"static const EquationKind EQUATION_KINDS[] = {{{', '.join(kinds) or '{{0}}'}}};",
        f"static const Equation EQUATIONS[] = {{{', '.join(equations) or '{0}'}}};",
    ]


def _integers(values: Sequence[int] | np.ndarray) -> str:
    return f"(const int[]){{{', '.join(map(str, values)) or '0'}}}"


def _pattern_source(name: str, pattern: Pattern, offset: int) -> str:
    return (
        f"static const Pattern {name} = {{{pattern.size}, {offset}, "
        f"{_integers(pattern.rows)}, {_integers(pattern.columns)}}};"
    )


def _declare(library: ctypes.CDLL) -> ctypes.CDLL:
    """The library, with the types of its functions' arguments and results."""
    for name, (result, arguments) in _signatures().items():
        if hasattr(library, name):  # games without constraints have no interior point method
            function = getattr(library, name)
            function.restype, function.argtypes = result, arguments
    return library


def _signatures() -> dict[str, tuple[object, list[object]]]:
    """Types of results and arguments of the functions of ``elimination.c`` and its companions."""
    work, real, integer = ctypes.POINTER(Work), ctypes.c_double, ctypes.c_int
    vector, rows = vector_pointer(1), vector_pointer(2)
    new_vector, new_rows, new_batch = (vector_pointer(ndim, output=True) for ndim in (1, 2, 3))
    counts = ndpointer(dtype=np.int32, ndim=1, flags=("C_CONTIGUOUS", "WRITEABLE"))
    flags = ndpointer(dtype=np.bool_, ndim=2, flags="C_CONTIGUOUS")
    return {
        "evaluate": (None, [work, rows, vector, new_rows]),
        "observation_loss": (real, [work, rows, new_rows]),
        "linearise": (integer, [work, rows, vector]),
        "linearise_condensed": (integer, [work, rows, vector, rows, rows, real]),
        "margins": (None, [work, rows, new_rows]),
        "push": (None, [work, rows, rows, new_rows]),
        "change": (None, [work, rows, rows, new_rows]),
        "step_margins": (None, [work, rows, vector, new_rows]),
        "solve": (None, [work, integer, rows, new_rows]),
        "sensitivities": (None, [work]),
        "reduced_hessian": (None, [work, rows, vector, rows, new_rows]),
        "trajectory_metric": (None, [work, new_rows]),
        "hessian_product": (None, [work, rows, vector, new_rows, new_vector]),
        "reduce": (None, [work, rows, new_vector]),
        "expand": (None, [work, vector, new_rows]),
        "costs": (None, [work, rows, vector, new_vector]),
        "response_space": (integer, [integer]),
        "responses": (
            None,
            [
                *(work, integer, integer, rows, vector, real, integer),
                *(new_batch, new_batch, new_vector, counts, counts, new_vector),
            ],
        ),
        "respond_in_turn": (
            integer,
            [work, integer, new_rows, vector, real, real, real, *(integer,) * 3, new_vector],
        ),
        "newton": (
            None,
            [work, integer, new_batch, rows, real, integer, real, integer, new_vector, counts],
        ),
        "interior_space": (integer, [integer]),
        "interior": (
            integer,
            [
                *(work, vector, vector, flags, integer, real, real, integer),
                *(new_rows, new_rows, new_vector, counts, new_vector),
            ],
        ),
    }
