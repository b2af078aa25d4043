"""A primal-dual interior-point method for the joint inverse problem, on the game's elimination.

    min_{theta, z}  f(z) = sum_t |y_t - h(x_t)|^2
    s.t.  G(z; theta) = 0,  sum theta^i = 1,  theta^i >= floor          (eqn. inverse_approach)

Where the game has hard constraints, z holds their multipliers and G their complementarity, relaxed
to 1e-9 (``games.compiled.complementarity``).

The method is that of IPOPT (Waechter and Biegler 2006; ``interior_point.c`` implements it and names
its equations), with other linear algebra. A prior of the weights is a barrier that does not go to
zero (``JointSettings.barrier``). G_z is square, so a step splits into a part that restores G = 0 at
fixed w = (x_1, theta) and a part along G = 0,

    dz = -G_z^-1 G + Z dw,      Z' H Z dw = -Z' (grad f - H G_z^-1 G) - barrier terms,

where Z and the products with G_z^-1 come from one sweep over time (``games.compiled.elimination``).
Only a system of the size of w, N n + N (K - 1), is dense; it is positive definite exactly where the
full system has the inertia of a minimum. Weights move on the tangent, so their sums are kept. If
the line search fails, restoration is Newton's method on G = 0 at fixed w.

Several motions, which may be of games of different structure and length, share weights: G and f are
sums over motions, w holds the initial state of each, and their sweeps stay apart.
"""

import ctypes
from collections.abc import Sequence
from functools import lru_cache
from importlib.resources import files
from itertools import count

import numpy as np

from olne_bench.estimators.shared.joint_problem import (
    JointPoint,
    JointSettings,
    JointSolution,
    SeenMotion,
    Status,
)
from olne_bench.games.compiled.bindings import check_size, dense, vector_pointer
from olne_bench.games.compiled.compiler import load
from olne_bench.games.compiled.elimination import Elimination, elimination
from olne_bench.games.model.game import Game
from olne_bench.games.model.observation import View
from olne_bench.games.model.simplex import sum_free
from olne_bench.games.solve.newton import pack, unpack

_SOURCE = files("olne_bench.estimators.shared").joinpath("interior_point.c")
_FUNCTIONS = (
    *("evaluate", "observation_loss", "linearise", "feedback", "solve", "reduce", "expand"),
    *("reduced_hessian", "trajectory_metric", "hessian_product", "newton"),
)


class _Structure(ctypes.Structure):
    """Sizes and functions of a structure of games; mirrors ``Structure`` of the C file."""

    _fields_ = (
        *((name, ctypes.c_int) for name in ("states", "thetas", "row", "primal")),
        *((name, ctypes.c_void_p) for name in _FUNCTIONS),
    )


class _Motion(ctypes.Structure):
    """Mirrors ``Motion`` of the C file."""

    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("work", "structure", "theta")),
        ("horizon", ctypes.c_int),
    )


class _Options(ctypes.Structure):
    """Sizes and options of a run, as in ``JointSettings``; mirrors ``Options`` of the C file."""

    _fields_ = (
        *((name, ctypes.c_int) for name in ("motions", "drivers", "weights", "unknowns")),
        *((name, ctypes.c_int) for name in ("max_iterations", "known")),
        *((name, ctypes.c_double) for name in ("first_barrier", "tolerance", "limit")),
    )


class _Prior(ctypes.Structure):
    """Bounds of theta, pulls and barriers; mirrors ``Prior`` of the C file."""

    _fields_ = tuple(
        (name, ctypes.c_void_p) for name in ("lower", "upper", "centre", "pull", "barrier")
    )


def solve_joint(
    game: Game,
    view: View,
    y: np.ndarray,
    start: JointPoint,
    settings: JointSettings | None = None,
    *,
    known: Sequence[JointSolution] = (),
) -> JointSolution:
    """Solve the joint problem of one motion y (T, N, d), NaN where missing, from one start.

    The start's weights lie above the floor and have row sums of one; its parameters are within
    their ranges. A run that comes close to a ``known`` optimum stops and counts as not converged,
    as it finds nothing new. Raises ValueError if no weights satisfy the floor, or on a wrong shape.
    """
    settings = settings or JointSettings()
    motion = SeenMotion(game, view, y, settings.noise_scale)
    return solve_joint_motions([motion], [start], settings, known=known)


def solve_joint_motions(
    motions: Sequence[SeenMotion],
    starts: Sequence[JointPoint],
    settings: JointSettings | None = None,
    *,
    known: Sequence[JointSolution] = (),
) -> JointSolution:
    """Solve the joint problem of several motions that share weights, as ``solve_joint`` does.

    A driver starts at the weights of the first motion in which it is; each motion has its own noise
    scale. Raises ValueError as ``solve_joint``, or if the games have different weights.
    """
    settings = settings or JointSettings()
    layout = _layout(*((one.game, tuple(one.rows), one.situation) for one in motions))
    settings.check_floor(layout.num_weights)
    solvers = _solvers(motions)
    for one, solver in zip(motions, solvers, strict=True):
        scale = np.ones(1)
        if len(one.noise_scale):
            scale = np.tile(one.noise_scale, one.game.num_players)
        solver.set_observations(np.asarray(one.y).reshape(one.game.horizon, -1), scale)
    parts = [
        pack(one.game, start.states, start.controls, start.costates, start.theta, solver)
        for one, start, solver in zip(motions, starts, solvers, strict=True)
    ]
    z, theta = np.concatenate([part.ravel() for part in parts]), layout.theta(starts)
    status, criterion, objective, iterations = _run(
        layout, motions, solvers, settings, known, z, theta
    )
    ends = np.cumsum([part.size for part in parts])[:-1]
    found = [part.reshape(old.shape) for part, old in zip(np.split(z, ends), parts, strict=True)]
    return JointSolution(
        points=tuple(
            JointPoint(*unpack(one.game, rows), *own)
            for one, rows, own in zip(motions, found, layout.split(theta), strict=True)
        ),
        objective=objective,
        iterations=iterations,
        status=status,
        penalty=criterion - objective,
    )


def joint_elimination(game: Game, view: View) -> Elimination:
    """Build (or fetch) the elimination of ``solve_joint``."""
    _library()
    return elimination(game, view)


class _Layout:
    """Where weights of drivers and unknowns of all motions are in the theta of each motion."""

    def __init__(self, parts: Sequence[tuple[Game, tuple[int, ...], int | None]]) -> None:
        """From the game of each motion, who its players are, and its situation."""
        self._games = [game for game, *_ in parts]
        if len({game.weight_names for game in self._games}) > 1:
            raise ValueError("motions can share weights only where their games have the same ones")
        self.num_weights = self._games[0].num_weights
        self.drivers = 1 + max(max(rows) for _, rows, _ in parts)
        self.unknowns, self.places = 0, []
        bounds = [np.zeros((3, self.drivers * self.num_weights))]
        known: dict[int, np.ndarray] = {}
        for game, rows, situation in parts:
            shape = game.num_players, game.parameters.count
            first = np.array(rows)[:, None] * self.num_weights
            if situation in known:
                own = known[situation]
            else:
                own = self.size + np.arange(np.prod(shape, dtype=int))
                self.unknowns += own.size
                of_unknowns = *game.parameters.bounds(), game.parameters.used
                bounds.append(np.array([np.ravel(row) for row in of_unknowns]).reshape(3, -1))
            if situation is not None:
                known[situation] = own
            place = np.hstack([first + np.arange(self.num_weights), own.reshape(shape)])
            self.places.append(place.ravel().astype(np.int32))
        self._bounds = np.hstack(bounds)

    @property
    def size(self) -> int:
        """Length of theta."""
        return self.drivers * self.num_weights + self.unknowns

    def theta(self, points: Sequence[JointPoint]) -> np.ndarray:
        """(size,) of a point of each motion."""
        found = np.zeros(self.size)
        for place, point in zip(reversed(self.places), reversed(points), strict=True):
            found[place] = dense("theta", point.theta.ravel(), place.shape)
        return found

    def split(self, theta: np.ndarray) -> list[tuple[np.ndarray, np.ndarray | None]]:
        """Weights (N, K) and parameters (N, U), None without, of each motion."""
        found: list[tuple[np.ndarray, np.ndarray | None]] = []
        for game, place in zip(self._games, self.places, strict=True):
            own = theta[place].reshape(game.num_players, -1)
            weights, parameters = np.split(own, [self.num_weights], axis=1)
            found.append((weights, parameters if parameters.size else None))
        return found

    def prior(self, settings: JointSettings) -> np.ndarray:
        """(5, size): lower and upper bounds, centre, pull and barrier of theta."""
        low, high, used = self._bounds
        nothing = np.zeros(self.size)
        # What stands for nothing is held where it is.
        found = np.array([low, high, nothing, np.where(used, settings.parameter_tie, 1.0), nothing])
        weights = slice(0, self.drivers * self.num_weights)
        found[0, weights], found[1, weights] = settings.weight_floor, np.inf
        found[2, weights], found[3, weights] = 1 / self.num_weights, settings.tie
        strengths = np.broadcast_to(settings.barrier, (self.drivers, self.num_weights))
        found[4, weights] = strengths.ravel()
        return found


@lru_cache(maxsize=64)
def _layout(*parts: tuple[Game, tuple[int, ...], int | None]) -> _Layout:
    return _Layout(parts)


def _solvers(motions: Sequence[SeenMotion]) -> list[Elimination]:
    """An elimination of each motion; each has a work space of its own."""
    used: dict[tuple[Game, View], count[int]] = {}
    places = [(one.game, one.view) for one in motions]
    return [elimination(*place, next(used.setdefault(place, count()))) for place in places]


def _run(
    layout: _Layout,
    motions: Sequence[SeenMotion],
    solvers: Sequence[Elimination],
    settings: JointSettings,
    known: Sequence[JointSolution],
    z: np.ndarray,
    theta: np.ndarray,
) -> tuple[Status, float, float, int]:
    """Improve z and theta in place; returns status, criterion, squared error and iterations."""
    options = _Options(
        *(len(motions), layout.drivers, layout.num_weights, layout.unknowns),
        *(settings.max_iterations, len(known)),
        *(settings.first_barrier, settings.tolerance, settings.limit),
    )
    structures = [_structure(solver) for solver in solvers]
    parts = zip(solvers, structures, layout.places, strict=True)
    given = (_Motion * len(motions))(
        *(
            _Motion(
                *(ctypes.addressof(solver.work), ctypes.addressof(structure)),
                *(place.ctypes.data, solver.horizon),
            )
            for solver, structure, place in parts
        )
    )
    objectives = np.array([solution.criterion for solution in known])
    optima = np.array([layout.theta(solution.points) for solution in known], dtype=float)
    prior, basis = layout.prior(settings), _basis(layout.num_weights)
    objective, iterations = np.zeros(2), ctypes.c_int()
    columns = layout.size + sum(structure.states for structure in structures)
    library = _library()
    space = library.interior_point_space(z.size, layout.size, columns, settings.max_iterations)
    status = library.interior_point(
        *(given, options, _Prior(*(row.ctypes.data for row in prior)), basis),
        dense("known objectives", objectives, (len(known),)),
        dense("known optima", optima.reshape(-1, layout.size), (len(known), layout.size)),
        *(np.empty(space), z, theta, objective, iterations),
    )
    return Status(status), float(objective[0]), float(objective[1]), iterations.value


@lru_cache(maxsize=32)
def _basis(num_weights: int) -> np.ndarray:
    """(K, K-1): changes of weights that keep their sum."""
    return np.ascontiguousarray(sum_free(num_weights))


def _structure(solver: Elimination) -> _Structure:
    stages = solver.stages
    primal = stages.num_states + stages.num_controls
    sizes = stages.num_states, stages.num_weights, stages.size, primal
    return _table(solver.library, *sizes)


@lru_cache(maxsize=128)
def _table(library: ctypes.CDLL, *sizes: int) -> _Structure:
    functions = (getattr(library, name) for name in _FUNCTIONS)
    addresses = (ctypes.cast(function, ctypes.c_void_p).value for function in functions)
    return _Structure(*sizes, *addresses)


@lru_cache(maxsize=1)
def _library() -> ctypes.CDLL:
    """``interior_point.c``, with the types of its functions' arguments."""
    library = load(_SOURCE.read_text())
    for k, mirror in enumerate((_Options, _Prior, _Structure, _Motion)):
        check_size(library.interior_point_sizes(k), ctypes.sizeof(mirror), mirror.__name__)
    library.interior_point.argtypes = [
        *(ctypes.POINTER(_Motion), ctypes.POINTER(_Options), ctypes.POINTER(_Prior)),
        *(vector_pointer(2), vector_pointer(1), vector_pointer(2)),
        *(vector_pointer(1, output=True) for _ in range(4)),
        ctypes.POINTER(ctypes.c_int),
    ]
    library.interior_point_space.argtypes = [ctypes.c_int] * 4
    library.interior_point_space.restype = ctypes.c_size_t
    return library
