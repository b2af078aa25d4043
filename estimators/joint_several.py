"""The joint problem of several trajectories of the same players, through IPOPT.

    min_{theta, z_1, ..., z_n}  sum_k sum_t |y_{k,t} - h(x_{k,t})|^2
    s.t.  G(z_k; theta) = 0 for every k,  sum theta^i = 1,  theta^i >= floor

with one theta for all (Peters et al. 2021: the method "applies coherently"), and an initial state
for each trajectory.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from olne_bench.estimators.joint_problem import JointPoint
from olne_bench.estimators.trajectory_fit import observation_parameters, squared_error
from olne_bench.games.game import Game
from olne_bench.games.ipopt import QUIET
from olne_bench.games.kkt import kkt_system
from olne_bench.games.observation import View, observation_size


@dataclass(frozen=True)
class SeveralSolution:
    """Where a start led: a point of each trajectory, all with the same weights.

    Attributes:
        points: one for each trajectory.
        objective: sum of squared observation errors of all.
        converged: whether this is a local optimum to IPOPT's tolerance.
        message: why not; empty where converged.
    """

    points: tuple[JointPoint, ...]
    objective: float
    converged: bool
    message: str


def solve_several(
    game: Game,
    view: View,
    ys: Sequence[np.ndarray],
    starts: Sequence[JointPoint],
    *,
    noise_scale: Sequence[float],
    weight_floor: float,
    max_iterations: int,
) -> SeveralSolution:
    """Solve the joint problem of all trajectories from one start.

    Args:
        game: the game.
        view: the observation model.
        ys: (T, N, d) observations of each trajectory.
        starts: a point of each; their weights are averaged.
        noise_scale: (d,) as of ``solve_joint``.
        weight_floor: smallest weight.
        max_iterations: iterations of IPOPT at most.
    """
    solver = several_solver(game, view, len(ys), max_iterations)
    weights = np.mean([start.weights for start in starts], axis=0)
    parts = [
        np.concatenate([part.ravel() for part in (start.states, start.controls, start.costates)])
        for start in starts
    ]
    lower = np.full(sum(part.size for part in parts) + weights.size, -np.inf)
    lower[-weights.size :] = weight_floor
    solution = solver(
        x0=np.concatenate([*parts, weights.ravel()]),
        lbx=lower,
        p=np.concatenate([observation_parameters(y, noise_scale) for y in ys]),
        lbg=0,
        ubg=0,
    )
    found = np.array(solution["x"]).ravel()
    weights = np.maximum(found[-weights.size :], 0.0).reshape(weights.shape)
    flat = found[: -weights.size].reshape(len(ys), -1)
    stats = solver.stats()
    return SeveralSolution(
        points=tuple(_point(game, row, weights) for row in flat),
        objective=float(solution["f"]),
        converged=bool(stats["success"]),
        message="" if stats["success"] else str(stats["return_status"]),
    )


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


@lru_cache(maxsize=8)
def several_solver(game: Game, view: View, count: int, max_iterations: int) -> ca.Function:
    """Build (or fetch) the solver for so many trajectories."""
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
    given = ca.MX.sym("data", data.numel(), count)
    sums = [ca.sum1(row) for row in ca.vertsplit(weights, game.num_weights)]
    problem = {
        "x": ca.vertcat(ca.vec(points), weights),
        "p": ca.vec(given),
        "f": ca.sum2(losses(points, given)),
        "g": ca.vertcat(
            ca.vec(residual(points, ca.repmat(weights, 1, count))), ca.vertcat(*sums) - 1
        ),
    }
    options = QUIET | {"ipopt.max_iter": max_iterations, "ipopt.tol": 1e-9}
    return ca.nlpsol("joint_several", "ipopt", problem, options)
