"""The joint inverse problem of one trajectory, or of several of the same players, through IPOPT.

    min_{theta, z_1, ..., z_n}  sum_k sum_t |y_{k,t} - h(x_{k,t})|^2
    s.t.  G(z_k; theta) = 0 for every k,  sum theta^i = 1,  theta^i >= floor

with one theta for all (Peters et al. 2021: the method "applies coherently"), and an initial state
for each trajectory. For one trajectory it is the reference for the fast solver.
"""

from collections.abc import Sequence
from functools import lru_cache

import casadi as ca
import numpy as np

from olne_bench.estimators.shared.joint_problem import (
    JointPoint,
    JointSettings,
    JointSolution,
    Status,
)
from olne_bench.estimators.shared.trajectory_fit import observation_parameters, squared_error
from olne_bench.games.model.game import Game
from olne_bench.games.model.observation import View, observation_size
from olne_bench.games.solve.ipopt import QUIET
from olne_bench.games.solve.kkt import kkt_system

_STATUSES = {
    "Maximum_Iterations_Exceeded": Status.NO_ITERATIONS,
    "Invalid_Number_Detected": Status.NOT_FINITE,
}


def solve_joint_ipopt(
    game: Game,
    view: View,
    ys: Sequence[np.ndarray],
    starts: Sequence[JointPoint],
    settings: JointSettings | None = None,
) -> JointSolution:
    """Solve the joint problem from one start; ValueError if no weights satisfy the floor.

    Each trajectory has observations (T, N, d) and a starting point; their weights are averaged.
    """
    settings = settings or JointSettings()
    settings.check_floor(game.num_weights)
    solver = joint_solver(
        game,
        view,
        len(ys),
        settings.max_iterations,
        settings.tolerance,
        bool(np.any(settings.barrier)),
    )
    weights = np.mean([start.weights for start in starts], axis=0)
    solution = solver(**_given(ys, starts, weights, settings), lbg=0, ubg=0)
    trajectories, own = np.split(np.array(solution["x"]).ravel(), [-weights.size])
    # IPOPT may violate a bound by its tolerance.
    weights = np.maximum(own, 0.0).reshape(weights.shape)
    status, detail = _outcome(solver)
    penalty = _penalty(settings, weights)
    return JointSolution(
        points=tuple(_point(game, row, weights) for row in trajectories.reshape(len(ys), -1)),
        objective=float(solution["f"]) - penalty,
        iterations=int(solver.stats()["iter_count"]),
        status=status,
        detail=detail,
        penalty=penalty,
    )


def _given(
    ys: Sequence[np.ndarray],
    starts: Sequence[JointPoint],
    weights: np.ndarray,
    settings: JointSettings,
) -> dict[str, np.ndarray]:
    """Start, lower bounds and parameters of the solver."""
    parts = [_flat(start) for start in starts]
    lower = np.full(sum(part.size for part in parts) + weights.size, -np.inf)
    lower[-weights.size :] = settings.weight_floor
    data = [observation_parameters(y, settings.noise_scale) for y in ys]
    strengths = np.broadcast_to(settings.barrier, weights.shape).ravel()
    return {
        "x0": np.concatenate([*parts, weights.ravel()]),
        "lbx": lower,
        "p": np.concatenate([*data, [settings.tie, settings.weight_floor], strengths]),
    }


def _flat(point: JointPoint) -> np.ndarray:
    parts = (point.states, point.controls, point.costates)
    return np.concatenate([part.ravel() for part in parts])


def _penalty(settings: JointSettings, weights: np.ndarray) -> float:
    """What tie and barrier add to the squared error at weights (N, K)."""
    penalty = settings.tie * float(np.sum((weights - 1 / weights.shape[1]) ** 2))
    if np.any(settings.barrier):
        gaps = np.maximum(weights - settings.weight_floor, np.finfo(float).tiny)
        penalty -= float(np.sum(settings.barrier * np.log(gaps)))
    return penalty


def _outcome(solver: ca.Function) -> tuple[Status, str]:
    stats = solver.stats()
    if stats["success"]:
        return Status.CONVERGED, ""
    reason = str(stats["return_status"])
    status = _STATUSES.get(reason, Status.IPOPT_FAILED)
    return status, reason if status is Status.IPOPT_FAILED else ""


def _point(game: Game, flat: np.ndarray, weights: np.ndarray) -> JointPoint:
    sizes = np.cumsum([np.prod(game.state_shape), np.prod(game.control_shape)])
    states, controls, costates = np.split(flat, sizes)
    steps, *shape = game.state_shape
    return JointPoint(
        states.reshape(game.state_shape),
        controls.reshape(game.control_shape),
        costates.reshape(steps - 1, *shape),
        weights,
    )


@lru_cache(maxsize=16)
def joint_solver(
    game: Game, view: View, count: int, max_iterations: int, tolerance: float, barrier: bool = False
) -> ca.Function:
    """Build (or fetch) the solver for ``count`` trajectories.

    Its variables are (x, u, lambda) of each, then theta; its parameters are samples and precision
    of each, then tie and floor of the weights and, with ``barrier``, its strengths.
    """
    system = kkt_system(game)
    z = ca.vertcat(system.states, system.controls, system.costates)
    samples = game.horizon * game.num_players * observation_size(view, game.dynamics)
    y, precision = ca.SX.sym("y", samples), ca.SX.sym("precision", samples)
    data = ca.vertcat(y, precision)
    loss = squared_error(game, view, system.states, y, precision)
    residual = ca.Function("residual", [z, system.weights], [system.residual]).map(count)
    losses = ca.Function("loss", [z, data], [loss]).map(count)

    points = ca.MX.sym("z", z.numel(), count)
    weights = ca.MX.sym("theta", system.weights.numel())
    given, terms = ca.MX.sym("data", data.numel(), count), ca.MX.sym("terms", 2)
    tie, floor = ca.vertsplit(terms)
    strengths = ca.MX.sym("strengths", weights.numel())
    added = tie * ca.sumsqr(weights - 1 / game.num_weights)
    if barrier:
        added -= ca.dot(strengths, ca.log(weights - floor))
    sums = [ca.sum1(row) for row in ca.vertsplit(weights, game.num_weights)]
    problem = {
        "x": ca.vertcat(ca.vec(points), weights),
        "p": ca.vertcat(ca.vec(given), terms, strengths),
        "f": ca.sum2(losses(points, given)) + added,
        "g": ca.vertcat(
            ca.vec(residual(points, ca.repmat(weights, 1, count))), ca.vertcat(*sums) - 1
        ),
    }
    options = QUIET | {"ipopt.max_iter": max_iterations, "ipopt.tol": tolerance}
    # One trajectory is small enough to be written out, which is faster.
    return ca.nlpsol("joint", "ipopt", problem, options | {"expand": count == 1})
