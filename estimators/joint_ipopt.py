"""The joint inverse problem through IPOPT: the reference that the fast solver is held to."""

from collections.abc import Sequence
from functools import lru_cache

import casadi as ca
import numpy as np

from olne_bench.estimators.joint_problem import JointPoint, JointSolution
from olne_bench.estimators.trajectory_fit import observation_parameters, squared_error
from olne_bench.games.game import Game
from olne_bench.games.ipopt import QUIET
from olne_bench.games.kkt import kkt_system
from olne_bench.games.observation import View, observation_size


def solve_joint_ipopt(
    game: Game,
    view: View,
    y: np.ndarray,
    start: JointPoint,
    *,
    noise_scale: Sequence[float] = (),
    weight_floor: float = 1e-5,
    tie: float = 0.0,
    max_iterations: int = 300,
) -> JointSolution:
    """Solve the joint problem from one start; arguments as in ``solve_joint``."""
    solver = joint_solver(game, view, max_iterations)
    parts = (start.states, start.controls, start.costates, start.weights)
    first = np.concatenate([part.ravel() for part in parts])
    lower = np.full(first.size, -np.inf)
    lower[-start.weights.size :] = weight_floor
    parameters = np.concatenate([observation_parameters(y, noise_scale), [tie]])
    solution = solver(x0=first, lbx=lower, p=parameters, lbg=0, ubg=0)
    stats = solver.stats()
    pieces = np.split(np.array(solution["x"]).ravel(), np.cumsum([p.size for p in parts])[:-1])
    shaped = [piece.reshape(part.shape) for piece, part in zip(pieces, parts, strict=True)]
    # IPOPT may pass a bound by its tolerance.
    shaped[-1] = np.maximum(shaped[-1], 0)
    return JointSolution(
        point=JointPoint(*shaped),
        objective=float(solution["f"]),
        iterations=int(stats["iter_count"]),
        converged=bool(stats["success"]),
        message="" if stats["success"] else str(stats["return_status"]),
    )


@lru_cache(maxsize=16)
def joint_solver(game: Game, view: View, max_iterations: int) -> ca.Function:
    """Build (or fetch) the solver."""
    system = kkt_system(game)
    count = game.horizon * game.num_players * observation_size(view, game.dynamics)
    y = ca.SX.sym("y", count)
    precision = ca.SX.sym("precision", y.numel())
    tie = ca.SX.sym("tie")
    untied = system.weights - 1 / game.num_weights
    sums = [ca.sum1(row) for row in ca.vertsplit(system.weights, game.num_weights)]
    problem = {
        "x": ca.vertcat(system.states, system.controls, system.costates, system.weights),
        "p": ca.vertcat(y, precision, tie),
        "f": squared_error(game, view, system.states, y, precision) + tie * ca.sumsqr(untied),
        "g": ca.vertcat(system.residual, ca.vertcat(*sums) - 1),
    }
    options = QUIET | {"ipopt.max_iter": max_iterations, "ipopt.tol": 1e-9}
    return ca.nlpsol("joint", "ipopt", problem, options)
