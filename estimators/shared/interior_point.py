"""A primal-dual interior-point method for the joint inverse problem, on the game's elimination.

    min_{theta, z}  f(z) = sum_t |y_t - h(x_t)|^2
    s.t.  G(z; theta) = 0,  sum theta^i = 1,  theta^i >= floor          (eqn. inverse_approach)

Where the game has hard constraints, z holds their multipliers and G their complementarity, relaxed
to 1e-9 (``games.compiled.complementarity``).

The method is that of IPOPT (Waechter and Biegler 2006; ``interior_point.c`` names its equations): a
monotone barrier on the bounds, exact second derivatives, inertia correction and a filter line
search with second-order corrections. A prior of the weights is a barrier that does not go to zero
(``JointSettings.barrier``). What differs is the linear algebra. G_z is square, so a step splits
into a part that restores G = 0 at fixed w = (x_1, theta) and a part along G = 0,

    dz = -G_z^-1 G + Z dw,      Z' H Z dw = -Z' (grad f - H G_z^-1 G) - barrier terms,

where Z and the products with G_z^-1 come from one sweep over time (``games.compiled.elimination``).
Only a system of the size of w, N n + N (K - 1), is dense. It is positive definite exactly where the
full system has the inertia of a minimum. The sums of weights hold at the start and are kept, as
weights move on the tangent. If the line search fails, restoration is Newton's method on G = 0 at
fixed w.

``interior_point.c`` implements all of it; this module checks the arguments.
"""

import ctypes
from collections.abc import Sequence
from functools import lru_cache
from importlib.resources import files
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from olne_bench.estimators.shared.joint_problem import (
    JointPoint,
    JointSettings,
    JointSolution,
    Status,
)
from olne_bench.games.compiled.bindings import Work, check_size, dense, vector_pointer
from olne_bench.games.compiled.elimination import Elimination, elimination
from olne_bench.games.model.game import Game
from olne_bench.games.model.observation import View
from olne_bench.games.model.simplex import sum_free
from olne_bench.games.solve.newton import pack, unpack

_NATIVE_SOURCE = files("olne_bench.estimators.shared").joinpath("interior_point.c").read_text()


class _Options(ctypes.Structure):
    """Options of a run, as in ``JointSettings``; mirrors ``Options`` of ``interior_point.c``."""

    _fields_ = (
        ("players", ctypes.c_int),
        ("max_iterations", ctypes.c_int),
        ("known", ctypes.c_int),
        ("first_barrier", ctypes.c_double),
        ("tolerance", ctypes.c_double),
        ("limit", ctypes.c_double),
    )


class _Prior(ctypes.Structure):
    """Bounds of theta, pulls and barriers; mirrors ``Prior`` of ``interior_point.c``."""

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
    """Solve the joint problem from one start.

    Args:
        game: the game.
        view: the observation model.
        y: (T, N, d) observations, NaN where missing.
        start: starting point; its weights lie above the floor and have row sums of one, its
            parameters within their ranges.
        settings: the problem's numbers, and limits.
        known: optima already found. A run that comes close to one stops and counts as not
            converged, as it finds nothing new.

    Raises:
        ValueError: if no weights satisfy the floor, or an array has the wrong shape.
    """
    settings = settings or JointSettings()
    settings.check_floor(game.num_weights)
    solver = joint_elimination(game, view)
    scale = np.ones(1)
    if len(settings.noise_scale):
        scale = np.tile(settings.noise_scale, game.num_players)
    solver.set_observations(np.asarray(y).reshape(game.horizon, -1), scale)
    theta = np.array(start.theta, dtype=float).ravel()
    z = pack(game, start.states, start.controls, start.costates, start.theta, solver)
    status, criterion, objective, iterations = _run(game, solver, settings, known, z, theta)
    weights, parameters = np.split(theta.reshape(game.num_players, -1), [game.num_weights], axis=1)
    found = parameters if parameters.size else None
    return JointSolution(
        points=(JointPoint(*unpack(game, z), weights, found),),
        objective=objective,
        iterations=iterations,
        status=status,
        penalty=criterion - objective,
    )


def joint_elimination(game: Game, view: View) -> Elimination:
    """Build (or fetch) the elimination of ``solve_joint``."""
    return elimination(game, view, _NATIVE_SOURCE)


def _run(
    game: Game,
    solver: Elimination,
    settings: JointSettings,
    known: Sequence[JointSolution],
    z: np.ndarray,
    theta: np.ndarray,
) -> tuple[Status, float, float, int]:
    """Improve z and theta in place; returns status, criterion, squared error and iterations."""
    options = _Options(
        players=game.num_players,
        max_iterations=settings.max_iterations,
        known=len(known),
        first_barrier=settings.first_barrier,
        tolerance=settings.tolerance,
        limit=settings.limit,
    )
    objectives = np.array([solution.criterion for solution in known])
    optima = np.array([solution.point.theta.ravel() for solution in known], dtype=float)
    prior = _prior(game, settings)
    basis = _basis(game.num_weights, game.parameters.count)
    objective, iterations = np.zeros(2), ctypes.c_int()
    run, space_needed = _declare(solver.library)
    status = run(
        solver.work,
        options,
        _Prior(*(row.ctypes.data for row in prior)),
        dense("basis", basis, basis.shape),
        dense("known objectives", objectives, (len(known),)),
        dense("known optima", optima.reshape(-1, theta.size), (len(known), theta.size)),
        np.empty(space_needed(game.horizon, settings.max_iterations)),
        dense("z", z, (game.horizon, solver.stages.size)),
        dense("theta", theta, (solver.stages.num_weights,)),
        objective,
        iterations,
    )
    return Status(status), float(objective[0]), float(objective[1]), iterations.value


def _prior(game: Game, settings: JointSettings) -> np.ndarray:
    """(5, N*(K+U)): lower and upper bounds, centre, pull and barrier of theta."""
    weights, count = (game.num_players, game.num_weights), game.num_weights
    low, high = game.parameters.bounds()
    parts = [
        (np.full(weights, settings.weight_floor), low),
        (np.full(weights, np.inf), high),
        (np.full(weights, 1 / count), np.zeros_like(low)),
        # What stands for nothing is held where it is.
        (
            np.full(weights, settings.tie),
            np.where(game.parameters.used, settings.parameter_tie, 1.0),
        ),
        (np.broadcast_to(settings.barrier, weights), np.zeros_like(low)),
    ]
    return np.ascontiguousarray([np.hstack(part).ravel() for part in parts])


@lru_cache(maxsize=32)
def _basis(num_weights: int, num_parameters: int) -> np.ndarray:
    """(K+U, K-1+U): changes of weights that keep their sum, and of parameters."""
    return np.ascontiguousarray(block_diag(sum_free(num_weights), np.eye(num_parameters)))


def _declare(library: ctypes.CDLL) -> tuple[Any, Any]:
    """The functions of ``interior_point.c``, with the types of their arguments."""
    run, space_needed = library.interior_point, library.interior_point_space
    if not run.argtypes:
        sizes = {"Options": _Options, "Prior": _Prior}
        for k, (name, mirror) in enumerate(sizes.items()):
            check_size(library.interior_point_sizes(k), ctypes.sizeof(mirror), name)
        run.argtypes = [
            *(ctypes.POINTER(Work), ctypes.POINTER(_Options), ctypes.POINTER(_Prior)),
            *(vector_pointer(2), vector_pointer(1), vector_pointer(2)),
            *(vector_pointer(1, output=True), vector_pointer(2, output=True)),
            *(vector_pointer(1, output=True), vector_pointer(1, output=True)),
            ctypes.POINTER(ctypes.c_int),
        ]
        space_needed.argtypes = [ctypes.c_int, ctypes.c_int]
        space_needed.restype = ctypes.c_size_t
    return run, space_needed
