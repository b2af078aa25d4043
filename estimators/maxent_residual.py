"""The maximum-entropy residual method (Inga, Bischoff, Koepf, Hohmann 2019), open-loop Nash.

Like ``kkt_residual``, it assumes that a pre-filtered trajectory was played (Peters et al. 2021,
eqn. pre_solve). Each player chooses its controls at random, those of lower cost more likely, while
those of the others are fixed:

    (X1)  p(u^i | u^-i, x_1; theta^i) = exp(-J^i(u^i)) / integral of exp(-J^i(v)) dv

With Laplace's approximation of the integral (Levine and Koltun 2012), gradient g (n,) and Hessian H
of J^i by u^i along the dynamics,

    (X2)  log p = -1/2 g' H^-1 g + 1/2 log det H - n/2 log 2 pi,

which is concave in theta^i where H is positive definite, as g = sum theta_k g_k and H = sum theta_k
H_k. With the Lagrangian L_k = J_k + lambda_k' F of each preference alone, x's sensitivity Z = dx/du
and z = (x, u),

    (X3)  F_x' lambda_k = -grad_x J_k,  g_k = grad_u L_k,  H_k = [Z; I]' L_k,zz [Z; I].

The scale of theta^i is an inverse temperature, estimated together with the direction, as in the
paper; theta^i is normalised only afterwards. Terms of several trajectories are summed:

    (X4)  max_theta  -1/2 g' H^-1 g + 1/2 log det H    s.t.  theta_k >= floor sum theta.

Without noise, g is zero at the truth and (X4) is unbounded along its ray: the search ends when the
derivative in the scale c, -n / 2c, is small. With noise, the pre-filter's error is taken for the
players' randomness, and the log-determinant favours weights that make H large.

If H is not positive definite at any weights tried as starts, the player's cost gets a further term
mu |u - u~|^2 / 2 per unit of weight, which does not change g (Levine and Koltun's dummy feature),
with the least mu that suffices; ``extras["regularisation"]`` holds mu.

Paper: Inga, Bischoff, Koepf, Hohmann 2019, after Levine and Koltun 2012.
Assumes: that the filtered trajectory was played, and that its deviations are the players' choice.
Cost: 0.2 s in all scenarios.
Trust: at very little noise and with full states; biased by noise, as `kkt_residual` is.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import casadi as ca
import numpy as np

from olne_bench.estimators.kkt_residual import pre_filter, residual_weights
from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.estimators.shared.trajectory_fit import warm_up_fit
from olne_bench.estimators.shared.white_noise import white_problem, with_white_noise
from olne_bench.games.model.game import Game
from olne_bench.games.model.unknowns import only_weights
from olne_bench.games.solve.ipopt import QUIET
from olne_bench.games.solve.kkt import kkt_system

#: Largest inverse temperature at the start, relative to that of weights whose sum is one.
_COLDEST = 1e9

#: Least eigenvalue of H at the start, relative to its mean eigenvalue there.
_LEAST_EIGENVALUE = 1e-3

#: Points from uniform weights to those of the residual method at which H is evaluated.
_STARTS = 5


@dataclass(frozen=True)
class Curvature:
    """Derivatives of one player's cost in its controls (n,), for each preference alone."""

    gradients: np.ndarray  # (n, K) columns g_k
    hessians: np.ndarray  # (K, n, n) H_k


@dataclass(frozen=True)
class MaxentResidual:
    """Maximises the Laplace approximation of the players' maximum-entropy likelihood."""

    name: ClassVar[str] = "maxent_residual"
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
        trajectories, messages = [], []
        for one in observations:
            (states, controls, _), fit = pre_filter(problem, one)
            trajectories.append((states, controls))
            if not fit.converged:
                messages.append(f"pre-filter: {fit.message}")
        curvatures = [curvature_along(problem.game, *one) for one in trajectories]
        guess = residual_weights(problem, *trajectories[0])
        players = [
            _maximise(tuple(own), guess[i], problem.weight_floor)
            for i, own in enumerate(zip(*curvatures, strict=True))
        ]
        messages += [
            f"player {i}: {player.message}" for i, player in enumerate(players) if player.message
        ]
        return Estimate(
            weights=np.array([player.weights for player in players]),
            states=trajectories[0][0],
            converged=not messages,
            message=messages[0] if messages else "",
            extras={
                "log_likelihood": sum(player.log_likelihood for player in players),
                "regularisation": np.array([player.regularisation for player in players]),
            },
        )

    def supports(self, problem: Problem) -> str | None:
        """Why this problem cannot be solved, or None."""
        if problem.game.constraints:
            return "first-order residuals know no constraints and take their forces for preferences"
        return only_weights(problem.game.parameters)

    def warm_up(self, problem: Problem) -> None:
        """Build the solvers."""
        problem = white_problem(problem)
        game = problem.game
        _player_functions(game)
        _solver((game.horizon - 1) * game.dynamics.control_size, game.num_weights, 1)
        for steps in (game.horizon, game.horizon + 1):
            warm_up_fit(game, problem.view, steps)


def curvature_along(game: Game, states: np.ndarray, controls: np.ndarray) -> list[Curvature]:
    """Every player's ``Curvature`` (X3) along a trajectory (T, N, n), (T-1, N, m)."""
    return [_curvature(game, function, states, controls) for function in _player_functions(game)]


def _curvature(
    game: Game, function: ca.Function, states: np.ndarray, controls: np.ndarray
) -> Curvature:
    size = (game.horizon - 1) * game.dynamics.state_size
    point, gradients, hessians = (states.ravel(), controls.ravel()), [], []
    for only in np.eye(game.num_weights):
        cost_gradient, _, motion = (np.array(v) for v in function(*point, np.zeros(size), only))
        by_state, by_control = motion[:, :size], motion[:, size:]
        costates = -np.linalg.solve(by_state.T, cost_gradient[:size])
        gradient, curvature, _ = (np.array(v) for v in function(*point, costates, only))
        sensitivity = np.vstack(
            [-np.linalg.solve(by_state, by_control), np.eye(by_control.shape[1])]
        )
        gradients.append(gradient[size:, 0])
        hessians.append(sensitivity.T @ curvature @ sensitivity)
    return Curvature(np.array(gradients).T, np.array(hessians))


@lru_cache(maxsize=16)
def _player_functions(game: Game) -> list[ca.Function]:
    """Per player: (x, u, lambda^i, theta^i) -> grad_z L^i, its Jacobian, that of F^i, by own z."""
    system, count = kkt_system(game), game.num_players
    n, m = game.dynamics.state_size, game.dynamics.control_size
    states = ca.vertsplit(system.states, n)[count:]
    controls, costates = ca.vertsplit(system.controls, m), ca.vertsplit(system.costates, n)
    state_rows = ca.vertsplit(system.stationarity_states, n)
    control_rows = ca.vertsplit(system.stationarity_controls, m)
    motion, weights = (
        ca.vertsplit(system.dynamics_error, n),
        ca.vertsplit(system.weights, game.num_weights),
    )
    functions = []
    for i in range(count):
        own = slice(i, None, count)
        unknowns = ca.vertcat(*states[own], *controls[own])
        gradient = ca.vertcat(*state_rows[own], *control_rows[own])
        arguments = [system.states, system.controls, ca.vertcat(*costates[own]), weights[i]]
        outputs = [
            gradient,
            ca.jacobian(gradient, unknowns),
            ca.jacobian(ca.vertcat(*motion[own]), unknowns),
        ]
        functions.append(ca.Function("curvature", arguments, outputs))
    return functions


@dataclass(frozen=True)
class _Maximum:
    weights: np.ndarray
    log_likelihood: float
    regularisation: float
    message: str


def _maximise(trajectories: Sequence[Curvature], guess: np.ndarray, floor: float) -> _Maximum:
    """(X4) for one player; theta is scaled by the optimum along the start's ray."""
    size, count = trajectories[0].gradients.shape
    start, mu = _start([one.hessians for one in trajectories], guess)
    hessians = [one.hessians + mu * np.eye(size) for one in trajectories]
    quadratic = sum(
        _quadratic(one.gradients @ start, start, own)
        for one, own in zip(trajectories, hessians, strict=True)
    )
    total = size * len(trajectories)
    scale = total / max(quadratic, total / _COLDEST)
    parameters = [
        packed(np.sqrt(scale) * one.gradients, own)
        for one, own in zip(trajectories, hessians, strict=True)
    ]
    solver = _solver(size, count, len(trajectories))
    solution = solver(x0=start, p=np.concatenate([*parameters, [floor]]), lbx=0.0, lbg=0.0)
    theta = np.array(solution["x"]).ravel()
    weights = np.maximum(theta / theta.sum(), floor)
    return _Maximum(
        weights=weights / weights.sum(),
        log_likelihood=total / 2 * np.log(scale / (2 * np.pi)) - float(solution["f"]),
        regularisation=mu,
        message="" if solver.stats()["success"] else str(solver.stats()["return_status"]),
    )


def packed(gradients: np.ndarray, hessians: np.ndarray) -> np.ndarray:
    """Columns g_k (n, K) and matrices H_k (K, n, n) as ``likelihood`` takes them."""
    return np.concatenate([gradients.T.ravel(), hessians.ravel()])


def _start(hessians: Sequence[np.ndarray], guess: np.ndarray) -> tuple[np.ndarray, float]:
    """Weights (K,) and a mu such that every H + mu I has a positive least eigenvalue there."""
    count = len(hessians[0])
    uniform = np.full(count, 1 / count)
    path = [uniform + part * (guess - uniform) for part in np.linspace(0, 0.9, _STARTS)]
    values = [np.linalg.eigvalsh([np.tensordot(s, h, axes=1) for h in hessians]) for s in path]
    missing = [
        float(np.max(_LEAST_EIGENVALUE * np.abs(own).mean(axis=1) - own[:, 0])) for own in values
    ]
    least = int(np.argmin(np.maximum(missing, 0.0)))
    return path[least], max(0.0, missing[least])


def _quadratic(gradient: np.ndarray, weights: np.ndarray, hessians: np.ndarray) -> float:
    return float(gradient @ np.linalg.solve(np.tensordot(weights, hessians, axes=1), gradient))


@lru_cache(maxsize=32)
def likelihood(size: int, count: int) -> ca.Function:
    """(theta (K,), ``packed``) -> (X2) less its constant; NaN where H is not positive definite."""
    theta = ca.SX.sym("theta", count)
    parameters = ca.SX.sym("p", size * count + size * size * count)
    gradients = ca.reshape(parameters[: size * count], size, count)
    hessians = ca.reshape(parameters[size * count :], size * size, count)
    factor = ca.chol(ca.reshape(hessians @ theta, size, size)).T
    whitened = ca.solve(factor, gradients @ theta)
    value = ca.sum1(ca.log(ca.diag(factor))) - ca.sumsqr(whitened) / 2
    return ca.Function("likelihood", [theta, parameters], [value])


@lru_cache(maxsize=32)
def _solver(size: int, count: int, trajectories: int) -> ca.Function:
    theta, floor = ca.MX.sym("theta", count), ca.MX.sym("floor")
    parameters = ca.MX.sym("p", size * count + size * size * count, trajectories)
    values = [likelihood(size, count)(theta, one) for one in ca.horzsplit(parameters)]
    problem = {
        "x": theta,
        "p": ca.vertcat(ca.vec(parameters), floor),
        "f": -sum(values),
        "g": theta - floor * ca.sum1(theta),
    }
    # Trial points where H is not positive definite are rejected, without a warning for each.
    return ca.nlpsol("maxent", "ipopt", problem, {**QUIET, "show_eval_warnings": False})
