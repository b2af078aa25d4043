"""How well the weights of a game can be known at all: Fisher information and Cramer-Rao bound.

The equilibrium trajectory is a function of (theta, x_1) through G(z; theta, x_1) = 0, so by the
implicit function theorem dz/d(theta, x_1) = -G_z^{-1} G_(theta, x_1). With white Gaussian noise of
standard deviation sigma on h(x), the Fisher information of (theta, x_1) is J'J / sigma^2, where J
is the sensitivity of all expected observations. Weights are known on the simplex only (each row
sums to one), so the bound is taken on its tangent space, with x_1 as a nuisance parameter.
"""

from collections.abc import Sequence
from functools import lru_cache

import casadi as ca
import numpy as np
from scipy.linalg import block_diag, null_space

from games.game import Game
from games.kkt import kkt_system
from games.newton import linearised
from games.observation import View

#: Above this condition number of the information matrix some weights are not identifiable.
_LARGEST_CONDITION = 1e14


def trajectory_sensitivity(
    game: Game,
    states: np.ndarray,
    controls: np.ndarray,
    costates: np.ndarray,
    weights: np.ndarray,
) -> np.ndarray:
    """d(states)/d(theta, x_1) at an equilibrium, (T*N*n, N*K + N*n), all in C order.

    Args:
        game: the game.
        states: (T, N, n) of the equilibrium.
        controls: (T-1, N, m).
        costates: (T-1, N, n).
        weights: (N, K).

    Raises:
        ValueError: where G_z is singular, so that the equilibrium is no function of them.
    """
    solver = linearised(game, states, controls, costates, weights)
    columns = solver.sensitivities()[:, : states[0].size].reshape(states.size, -1)
    return np.hstack([columns[:, states[0].size :], columns[:, : states[0].size]])


def observation_sensitivity(
    game: Game,
    view: View,
    states: np.ndarray,
    controls: np.ndarray,
    costates: np.ndarray,
    weights: np.ndarray,
    *,
    noise_scale: Sequence[float] | np.ndarray | None = None,
) -> np.ndarray:
    """d(h(states))/d(theta, x_1) at an equilibrium, (T*N*d, N*K + N*n), all in C order.

    The arguments are those of ``trajectory_sensitivity``; ``noise_scale`` (d,) holds the relative
    standard deviations of the noise on what the view shows of a player, ones where absent, and
    divides the rows.

    Raises:
        ValueError: where G_z is singular.
    """
    sensitivity = trajectory_sensitivity(game, states, controls, costates, weights)
    observed = _view_jacobian(game, view)(states.ravel()).sparse() @ sensitivity
    if noise_scale is not None:
        observed /= np.tile(noise_scale, game.horizon * game.num_players)[:, None]
    return np.asarray(observed)


def weight_covariance(
    game: Game,
    view: View,
    states: np.ndarray,
    controls: np.ndarray,
    costates: np.ndarray,
    weights: np.ndarray,
    *,
    noise_scale: np.ndarray | None = None,
) -> np.ndarray | None:
    """Cramer-Rao bound of the weights (N*K, N*K) for unit noise; None if not identifiable.

    Multiply by sigma^2. The arguments are those of ``observation_sensitivity``.
    """
    sensitivity = observation_sensitivity(
        game, view, states, controls, costates, weights, noise_scale=noise_scale
    )
    return joint_weight_covariance(game, [sensitivity])


def joint_weight_covariance(game: Game, sensitivities: Sequence[np.ndarray]) -> np.ndarray | None:
    """Cramer-Rao bound of weights that several trajectories share, for unit noise.

    Every trajectory has an unknown initial state of its own.

    Args:
        game: the game.
        sensitivities: ``observation_sensitivity`` of each trajectory, without the rows of samples
            that are missing.

    Returns:
        (N*K, N*K), or None if not identifiable.
    """
    tangent = block_diag(*[null_space(np.ones((1, game.num_weights)))] * game.num_players)
    free = tangent.shape[1]
    of_weights = [columns[:, : len(tangent)] @ tangent for columns in sensitivities]
    of_starts = block_diag(*[columns[:, len(tangent) :] for columns in sensitivities])
    observed = np.hstack([np.vstack(of_weights), of_starts])
    information = observed.T @ observed
    if not np.linalg.cond(information) < _LARGEST_CONDITION:
        return None
    return tangent @ np.linalg.inv(information)[:free, :free] @ tangent.T


def cosine_error_limit(covariance: np.ndarray, weights: np.ndarray) -> float:
    """Expected cosine error (eqn. cosine_metric) of an efficient estimator.

    To second order ``E[1 - cos] = mean_i tr(P_i C_i) / (2 |theta_i|^2)`` with P_i the projection
    orthogonal to theta_i.

    Args:
        covariance: (N*K, N*K) of the weights.
        weights: (N, K) true weights.
    """
    count = weights.shape[1]
    errors = []
    for i, theta in enumerate(weights):
        block = covariance[i * count : (i + 1) * count, i * count : (i + 1) * count]
        squared = theta @ theta
        projection = np.eye(count) - np.outer(theta, theta) / squared
        errors.append(np.trace(projection @ block) / (2 * squared))
    return float(np.mean(errors))


@lru_cache(maxsize=16)
def _view_jacobian(game: Game, view: View) -> ca.Function:
    system = kkt_system(game)
    expected = [
        view.expected(state, game.dynamics)
        for state in ca.vertsplit(system.states, game.dynamics.state_size)
    ]
    jacobian = ca.jacobian(ca.vertcat(*expected), system.states)
    return ca.Function("h_x", [system.states], [jacobian])
