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
from typing import ClassVar

import numpy as np
import scipy
from scipy.linalg import qr

from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.estimators.shared.trajectory_fit import TrajectoryFit, fit_trajectory, warm_up_fit
from olne_bench.estimators.shared.white_noise import white_problem, with_white_noise
from olne_bench.games.compiled.elimination import elimination
from olne_bench.games.model.game import Game
from olne_bench.games.model.unknowns import only_weights
from olne_bench.games.solve.newton import pack


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
        elimination(problem.game)
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
    by_weights = _by_weights(game, states, controls)
    matrices = []
    for in_weights, in_costates in zip(
        by_weights, _by_costates(game, states, controls), strict=True
    ):
        basis, _ = qr(in_costates)
        matrices.append((basis.T @ in_weights)[in_costates.shape[1] :])
    if last_controls is None:
        return matrices
    # Of the motion one step later, the rows of its last controls.
    later = np.concatenate([states[1:], states[-1:]])
    by_weights = _by_weights(game, later, np.concatenate([controls[1:], last_controls[None]]))
    last = by_weights[:, -game.dynamics.control_size :]
    return [np.vstack(both) for both in zip(matrices, last, strict=True)]


def _by_weights(game: Game, states: np.ndarray, controls: np.ndarray) -> np.ndarray:
    """A^i (N, S, K) along a motion; the S rows are those of x_2..x_T, then of u_1..u_{T-1}."""
    nothing = np.zeros_like(states[1:])
    alone = np.eye(game.num_weights)
    found = [_stationarity(game, states, controls, nothing, weights) for weights in alone]
    return np.stack([np.concatenate(rows, axis=1) for rows in found], axis=-1)


def _by_costates(game: Game, states: np.ndarray, controls: np.ndarray) -> np.ndarray:
    """B^i (N, S, (T-1) n).

    A costate is in the rows of its step's state and control, and in those of the next state by 1.
    """
    steps, n = len(controls), game.dynamics.state_size
    of_states = np.zeros((game.num_players, steps, n, steps, n))
    of_controls = np.zeros((game.num_players, steps, game.dynamics.control_size, steps, n))
    now, no_weights = np.arange(steps), np.zeros(game.num_weights)
    of_states[:, now, :, now] = np.eye(n)
    for c, one in enumerate(np.eye(n)):
        costates = np.broadcast_to(one, states[1:].shape)
        rows = _stationarity(game, states, controls, costates, no_weights)
        by_state, by_control = (part.reshape(game.num_players, steps, -1) for part in rows)
        of_states[:, now[:-1], :, now[1:], c] = (by_state[:, :-1] - one).swapaxes(0, 1)
        of_controls[:, now, :, now, c] = by_control.swapaxes(0, 1)
    both = of_states, of_controls
    return np.concatenate([part.reshape(game.num_players, -1, steps * n) for part in both], axis=1)


def _stationarity(
    game: Game, states: np.ndarray, controls: np.ndarray, costates: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rows of G of states (N, (T-1) n) and of controls (N, (T-1) m), all players of the weights."""
    z = pack(game, states, controls, costates, weights)
    rows = elimination(game).evaluate(z, np.tile(weights, game.num_players))
    size, (steps, players, m) = states[0].size, controls.shape
    of_states = rows[1:, :size].reshape(steps, players, -1)
    of_controls = rows[:-1, size : size + players * m].reshape(controls.shape) / game.dt
    return (
        of_states.swapaxes(0, 1).reshape(players, -1),
        of_controls.swapaxes(0, 1).reshape(players, -1),
    )


def _player_weights(rows: np.ndarray, floor: float) -> tuple[np.ndarray, float]:
    """Minimise |rows theta|^2 over the simplex with theta >= floor; theta and the minimum.

    With theta = floor + (1 - K floor) phi the problem is again homogeneous in phi, on the plain
    simplex. Its minimiser is, up to scale, that of the non-negative least-squares problem
    min |M phi|^2 + (1' phi - 1)^2, which a library solves exactly.
    """
    count = rows.shape[1]
    shifted = floor * rows.sum(axis=1, keepdims=True) + (1 - count * floor) * rows
    scale = np.linalg.norm(shifted) or 1.0
    phi, _ = scipy.optimize.nnls(  # imported now: it takes long
        np.vstack([shifted / scale, np.ones((1, count))]),
        np.concatenate([np.zeros(len(shifted)), [1.0]]),
    )
    theta = floor + (1 - count * floor) * phi / phi.sum()
    return theta, float(np.sum((rows @ theta) ** 2))
