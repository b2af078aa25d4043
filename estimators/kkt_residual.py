"""The KKT-residual baseline (Rothfuss et al. 2017; Awasthi and Lamperski 2020).

Two stages (Peters et al. 2021, Sec. Baseline): a pre-filter recovers the most likely dynamically
feasible trajectory (eqn. pre_solve), then the weights and costates minimise the first-order
residual along it (eqn. kkt_residual_baseline):

    min_{theta, lambda} |G(x~, u~, lambda; theta)|^2   s.t.  sum theta^i = 1,  theta^i >= floor.

Given the trajectory, G is linear in (theta, lambda) and the players separate:
G^i = A^i theta^i + B^i lambda^i. The costates are free, so a QR factorisation of B^i removes
them and a non-negative least-squares problem with K columns is left.

Paper: Rothfuss et al. 2017; Awasthi and Lamperski 2020.
Assumes: that the filtered trajectory is the one that the players played.
Cost: 7 ms for two players, 10 ms for five, 17 ms on roads, nearly all of it the pre-filter.
Trust: at very little noise and with full states. It takes errors of the trajectory for preferences,
    so it is biased by noise and by partial views.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import casadi as ca
import numpy as np
from scipy.linalg import qr
from scipy.optimize import nnls

from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.estimators.shared.trajectory_fit import TrajectoryFit, fit_trajectory, warm_up_fit
from olne_bench.estimators.shared.white_noise import white_problem, with_white_noise
from olne_bench.games.model.costs import Stage
from olne_bench.games.model.game import Game
from olne_bench.games.model.unknowns import only_weights
from olne_bench.games.solve.kkt import kkt_system


@dataclass(frozen=True)
class KktResidual:
    """Minimises the KKT residual along a pre-filtered trajectory.

    The residual is a sum of squares of unlike quantities, so its units matter. They are those of
    the published code: controls per step rather than per second, which scales the control rows
    by 1/dt. As published, the pre-filter also uses one sample beyond the horizon, which makes the
    last speed observable, and the control u_T before it, whose stationarity adds one row per
    control. Both visibly affect the failures.
    """

    name: ClassVar[str] = "kkt_residual"
    several: ClassVar[bool] = True

    def estimate(
        self,
        problem: Problem,
        observation: Observation | Sequence[Observation],
        *,
        rng: np.random.Generator,
        budget: float,
    ) -> Estimate:
        problem, observations = with_white_noise(problem, observation)
        fits = [pre_filter(problem, one) for one in observations]
        reduced = [_reduced_residuals(problem.game, *trajectory) for trajectory, _ in fits]
        # The trajectories of a player share its weights: their rows are stacked.
        results = [
            _player_weights(np.vstack(rows), problem.weight_floor)
            for rows in zip(*reduced, strict=True)
        ]
        failed = [fit.message for _, fit in fits if not fit.converged]
        return Estimate(
            weights=np.array([weights for weights, _ in results]),
            states=fits[0][0][0],
            converged=not failed,
            message=f"pre-filter: {failed[0]}" if failed else "",
            extras={"objective": float(sum(residual for _, residual in results))},
        )

    def supports(self, problem: Problem) -> str | None:
        """Why this problem cannot be solved, or None."""
        if problem.game.constraints:
            return "first-order residuals know no constraints and take their forces for preferences"
        return only_weights(problem.game.parameters)

    def warm_up(self, problem: Problem) -> None:
        """Build the solvers."""
        problem = white_problem(problem)
        _residual_functions(problem.game)
        for steps in (problem.game.horizon, problem.game.horizon + 1):
            warm_up_fit(problem.game, problem.view, steps)


def residual_weights(problem: Problem, states: np.ndarray, controls: np.ndarray) -> np.ndarray:
    """Weights (N, K) of least residual along a trajectory (T, N, n), (T-1, N, m)."""
    reduced = _reduced_residuals(problem.game, states, controls, None)
    return np.array([_player_weights(rows, problem.weight_floor)[0] for rows in reduced])


_Trajectory = tuple[np.ndarray, np.ndarray, np.ndarray | None]


def pre_filter(problem: Problem, observation: Observation) -> tuple[_Trajectory, TrajectoryFit]:
    """States (T, N, n), controls (T-1, N, m), u_T (N, m) or None; and the fit as a whole."""
    horizon, y, extra = problem.game.horizon, observation.y, observation.extra
    if extra is not None:
        y = np.concatenate([y, extra[None]])
    fit = fit_trajectory(problem.game, problem.view, y, problem.noise_scale)
    last_controls = None if extra is None else fit.controls[horizon - 1]
    return (fit.states[:horizon], fit.controls[: horizon - 1], last_controls), fit


def _reduced_residuals(
    game: Game, states: np.ndarray, controls: np.ndarray, last_controls: np.ndarray | None
) -> list[np.ndarray]:
    """Per player a matrix M (rows, K) with min_lambda |G^i|^2 = |M theta^i|^2."""
    stationarity, last_stationarity = _residual_functions(game)
    matrices = []
    for i in range(game.num_players):
        in_weights, in_costates = (
            np.array(block) for block in stationarity[i](states.ravel(), controls.ravel())
        )
        basis, _ = qr(in_costates)
        rows = (basis.T @ in_weights)[in_costates.shape[1] :]
        if last_controls is not None:
            last = last_stationarity[i](states[-1].ravel(), last_controls[i])
            rows = np.vstack([rows, np.array(last)])
        matrices.append(rows)
    return matrices


def _player_weights(rows: np.ndarray, floor: float) -> tuple[np.ndarray, float]:
    """Minimise |rows theta|^2 over the simplex with theta >= floor; theta and the minimum.

    With theta = floor + (1 - K floor) phi the problem is again homogeneous in phi, on the plain
    simplex. Its minimiser is, up to scale, that of the non-negative least-squares problem
    min |M phi|^2 + (1' phi - 1)^2, which a library solves exactly.
    """
    count = rows.shape[1]
    shifted = floor * rows.sum(axis=1, keepdims=True) + (1 - count * floor) * rows
    scale = np.linalg.norm(shifted) or 1.0
    phi, _ = nnls(
        np.vstack([shifted / scale, np.ones((1, count))]),
        np.concatenate([np.zeros(len(shifted)), [1.0]]),
    )
    theta = floor + (1 - count * floor) * phi / phi.sum()
    return theta, float(np.sum((rows @ theta) ** 2))


@lru_cache(maxsize=16)
def _residual_functions(game: Game) -> tuple[list[ca.Function], list[ca.Function]]:
    """Per player and step: (x, u) -> (A^i, B^i), and (x_T, u_T^i) -> rows of the last control."""
    system = kkt_system(game)
    n, m = game.dynamics.state_size, game.dynamics.control_size
    state_rows = ca.vertsplit(system.stationarity_states, n)
    control_rows = ca.vertsplit(system.stationarity_controls, m)
    costates = ca.vertsplit(system.costates, n)
    weights = ca.vertsplit(system.weights, game.num_weights)

    stationarity, last_stationarity = [], []
    for i, player in enumerate(game.players):
        own = slice(i, None, game.num_players)
        rows = ca.vertcat(*state_rows[own], ca.vertcat(*control_rows[own]) / game.dt)
        arguments = [system.states, system.controls]
        blocks = [ca.jacobian(rows, weights[i]), ca.jacobian(rows, ca.vertcat(*costates[own]))]
        stationarity.append(ca.Function("residual", arguments, blocks))

        state, control = ca.SX.sym("x", n * game.num_players), ca.SX.sym("u", m)
        stage = Stage(i, tuple(ca.vertsplit(state, n)), control, game.dynamics, game.dt)
        gradient = ca.gradient(player.running_cost(stage, weights[i]), control) / game.dt
        last = ca.jacobian(gradient, weights[i])
        last_stationarity.append(ca.Function("last_residual", [state, control], [last]))
    return stationarity, last_stationarity
