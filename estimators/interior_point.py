"""A primal-dual interior-point method for the joint inverse problem, on the game's elimination.

    min_{theta, z}  f(z) = sum_t |y_t - h(x_t)|^2
    s.t.  G(z; theta) = 0,  sum theta^i = 1,  theta^i >= floor          (eqn. inverse_approach)

The method is that of IPOPT (Waechter and Biegler 2006; ``interior_point.c`` names its equations): a
monotone barrier on the bounds, exact second derivatives, inertia correction and a filter line
search with second-order corrections. What differs is the linear algebra. G_z is square, so a step
splits into a part that restores G = 0 at fixed w = (x_1, theta) and a part along G = 0,

    dz = -G_z^-1 G + Z dw,      Z' H Z dw = -Z' (grad f - H G_z^-1 G) - barrier terms,

where Z and the products with G_z^-1 come from one sweep over time (``games.elimination``). Only a
system of the size of w, N n + N (K - 1), is dense. It is positive definite exactly where the full
system has the inertia of a minimum. The sums of weights hold at the start and are kept, as weights
move on the tangent. If the line search fails, restoration is Newton's method on G = 0 at fixed w.

``interior_point.c`` implements all of it; this module checks the arguments. Without a compiler,
IPOPT is used instead (``joint_ipopt``).
"""

import ctypes
from collections.abc import Sequence
from importlib.resources import files
from typing import Any

import numpy as np

from olne_bench.estimators.joint_ipopt import solve_joint_ipopt
from olne_bench.estimators.joint_problem import JointPoint, JointSettings, JointSolution, Status
from olne_bench.games.elimination import Elimination
from olne_bench.games.game import Game
from olne_bench.games.native import NativeElimination, Work, dense, elimination, vector_pointer
from olne_bench.games.newton import pack, unpack
from olne_bench.games.observation import View
from olne_bench.games.simplex import sum_free

_NATIVE_SOURCE = files("olne_bench.estimators").joinpath("interior_point.c").read_text()


class _Options(ctypes.Structure):
    """Options of a run, as in ``JointSettings``; mirrors ``Options`` of ``interior_point.c``."""

    _fields_ = (
        ("players", ctypes.c_int),
        ("max_iterations", ctypes.c_int),
        ("known", ctypes.c_int),
        ("floor", ctypes.c_double),
        ("tie", ctypes.c_double),
        ("first_barrier", ctypes.c_double),
        ("tolerance", ctypes.c_double),
        ("limit", ctypes.c_double),
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
        start: starting point; its weights lie above the floor and have row sums of one.
        settings: the problem's numbers, and limits.
        known: optima already found. A run that comes close to one stops and counts as not
            converged, as it finds nothing new. IPOPT ignores them.

    Raises:
        ValueError: if no weights satisfy the floor, or an array has the wrong shape.
    """
    settings = settings or JointSettings()
    settings.check_floor(game.num_weights)
    solver = joint_elimination(game, view)
    if not isinstance(solver, NativeElimination):
        return solve_joint_ipopt(game, view, [y], [start], settings)
    scale = np.ones(1)
    if len(settings.noise_scale):
        scale = np.tile(settings.noise_scale, game.num_players)
    solver.set_observations(np.asarray(y).reshape(game.horizon, -1), scale)
    z = pack(game, start.states, start.controls, start.costates)
    theta = np.array(start.weights, dtype=float).ravel()
    status, objective, iterations = _run(game, solver, settings, known, z, theta)
    return JointSolution(
        points=(JointPoint(*unpack(game, z), theta.reshape(start.weights.shape)),),
        objective=objective,
        iterations=iterations,
        status=status,
    )


def joint_elimination(game: Game, view: View) -> Elimination:
    """Build (or fetch) the elimination of ``solve_joint``: a ``NativeElimination`` if possible."""
    return elimination(game, view, _NATIVE_SOURCE)


def _run(
    game: Game,
    solver: NativeElimination,
    settings: JointSettings,
    known: Sequence[JointSolution],
    z: np.ndarray,
    theta: np.ndarray,
) -> tuple[Status, float, int]:
    """Improve z and theta in place; returns status, objective and iterations."""
    options = _Options(
        players=game.num_players,
        max_iterations=settings.max_iterations,
        known=len(known),
        floor=settings.weight_floor,
        tie=settings.tie,
        first_barrier=settings.first_barrier,
        tolerance=settings.tolerance,
        limit=settings.limit,
    )
    objectives = np.array([solution.objective for solution in known])
    weights = np.array([solution.point.weights.ravel() for solution in known], dtype=float)
    objective, iterations = ctypes.c_double(), ctypes.c_int()
    run, space_needed = _declare(solver.library)
    status = run(
        solver.work,
        options,
        dense("basis", sum_free(game.num_weights), (game.num_weights, game.num_weights - 1)),
        dense("known objectives", objectives, (len(known),)),
        dense("known weights", weights.reshape(-1, theta.size), (len(known), theta.size)),
        np.empty(space_needed(game.horizon, settings.max_iterations)),
        dense("z", z, (game.horizon, solver.stages.size)),
        dense("theta", theta, (solver.stages.num_weights,)),
        objective,
        iterations,
    )
    return Status(status), objective.value, iterations.value


def _declare(library: ctypes.CDLL) -> tuple[Any, Any]:
    """The functions of ``interior_point.c``, with the types of their arguments."""
    run, space_needed = library.interior_point, library.interior_point_space
    if not run.argtypes:
        run.argtypes = [
            *(ctypes.POINTER(Work), ctypes.POINTER(_Options)),
            *(vector_pointer(2), vector_pointer(1), vector_pointer(2)),
            *(vector_pointer(1, output=True), vector_pointer(2, output=True)),
            vector_pointer(1, output=True),
            *(ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_int)),
        ]
        space_needed.argtypes = [ctypes.c_int, ctypes.c_int]
        space_needed.restype = ctypes.c_size_t
    return run, space_needed
