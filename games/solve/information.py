"""Identifiability of a game's weights: Fisher information and Cramer-Rao bound.

By the implicit function theorem for G(z; theta, x_1) = 0, dz/d(theta, x_1) = -G_z^{-1} G_(theta,
x_1). With white Gaussian noise of standard deviation sigma on h(x), the Fisher information of
(theta, x_1) is J'J / sigma^2, where J is the sensitivity of the samples that were seen; other noise
is whitened first. The bound is taken on the tangent space of the simplex, with x_1 as a nuisance
parameter.
"""

from collections.abc import Sequence
from functools import lru_cache

import casadi as ca
import numpy as np

from olne_bench.games.compiled.elimination import Elimination
from olne_bench.games.compiled.row_functions import RowFunction
from olne_bench.games.model.dynamics import Dynamics
from olne_bench.games.model.game import Game
from olne_bench.games.model.identifiability import Identifiability, identified_at
from olne_bench.games.model.observation import View, whitening
from olne_bench.games.model.simplex import theta_tangent
from olne_bench.games.solve.newton import linearised

#: Above this condition number of the information matrix some weights are not identifiable.
_LARGEST_CONDITION = 1e14

UNOBSERVED_ABOVE = 0.99  # of the prior variance of an unknown


def trajectory_sensitivity(
    game: Game,
    states: np.ndarray,
    controls: np.ndarray,
    costates: np.ndarray,
    weights: np.ndarray,
    solver: Elimination | None = None,
) -> np.ndarray:
    """d(states)/d(theta, x_1) at an equilibrium, (T*N*n, N*K + N*n), all in C order.

    States are (T, N, n), controls (T-1, N, m), costates (T-1, N, n), weights (N, K). Raises
    ValueError if G_z is singular; the equilibrium is then not a function of (theta, x_1).
    """
    solver = linearised(game, states, controls, costates, weights, solver)
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
    noise_covariance: Sequence[Sequence[float]] | np.ndarray | None = None,
    solver: Elimination | None = None,
) -> np.ndarray:
    """d(h(states))/d(theta, x_1) at an equilibrium, (T*N*d, N*K + N*n), all in C order.

    The arguments are those of ``trajectory_sensitivity``. The rows are divided by ``noise_scale``
    (d,), the relative standard deviations of the noise on a player's observed components, each one
    by default. For correlated noise, ``noise_covariance`` (d, d) relative to sigma^2 replaces it:
    the rows of one player and step are whitened together. Raises ValueError if G_z is singular or
    the covariance is not positive definite.
    """
    sensitivity = trajectory_sensitivity(game, states, controls, costates, weights, solver)
    rows = states.reshape(-1, game.dynamics.state_size)
    by_state = _view_jacobian(game.dynamics, view)(rows)
    by_state = by_state.reshape(len(rows), rows.shape[1], -1).transpose(0, 2, 1)
    if noise_covariance is not None:
        by_state = whitening(noise_covariance) @ by_state
    elif noise_scale is not None:
        by_state = by_state / np.asarray(noise_scale)[:, None]
    observed = by_state @ sensitivity.reshape(*rows.shape, -1)
    return np.asarray(observed.reshape(-1, sensitivity.shape[1]))


def weight_covariance(
    game: Game,
    view: View,
    states: np.ndarray,
    controls: np.ndarray,
    costates: np.ndarray,
    weights: np.ndarray,
    *,
    noise_scale: np.ndarray | None = None,
    noise_covariance: np.ndarray | None = None,
) -> np.ndarray | None:
    """Cramer-Rao bound of the weights (N*K, N*K) for unit noise; None if not identifiable."""
    sensitivity = observation_sensitivity(
        game,
        view,
        states,
        controls,
        costates,
        weights,
        noise_scale=noise_scale,
        noise_covariance=noise_covariance,
    )
    return joint_weight_covariance(game, [sensitivity])


def of_seen(sensitivity: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The rows of an ``observation_sensitivity`` whose samples in y (T, N, d) are not missing."""
    return np.asarray(sensitivity[np.isfinite(y).ravel()])


def joint_weight_covariance(
    game: Game,
    sensitivities: Sequence[np.ndarray],
    *,
    unobserved: np.ndarray | None = None,
    prior_scale: float = 0.0,
) -> np.ndarray | None:
    """Cramer-Rao bound of weights (N*K, N*K) of several trajectories, for unit noise.

    Args:
        game: the game; standardised values of unknowns stand behind weights: (N*(K+U), N*(K+U)).
        sensitivities: ``observation_sensitivity`` of each, with its own start, for seen samples
            only.
        unobserved: (N, U) which unknowns are left out, as they do not show.
        prior_scale: standard deviation of the noise, if the priors of the game's unknowns count;
            the result is then the inverse of the information of both, not a bound.

    Returns None if not identifiable.
    """
    tangent = theta_tangent(game.num_weights, game.parameters.used)
    if unobserved is not None:
        tangent = tangent[:, ~tangent[in_theta(game, unobserved)].any(axis=0)]
    observed = _on_tangent(tangent, sensitivities)
    information = observed.T @ observed
    unknowns = np.tile(np.arange(len(tangent) // game.num_players), game.num_players)
    of_unknowns = tangent[unknowns >= game.num_weights].any(axis=0)
    information[np.diag_indices(tangent.shape[1])] += prior_scale**2 * of_unknowns
    return inverse_on_tangent(information, tangent)


def inverse_on_tangent(information: np.ndarray, tangent: np.ndarray) -> np.ndarray | None:
    """Covariance of theta, whose changes a tangent (theta, F) spans; None if not identifiable.

    The information is of these changes, which come first, and of what else is unknown.
    """
    # The matrix is symmetric: its eigenvalues give condition and inverse at once.
    values, vectors = np.linalg.eigh(information)
    if not values[-1] < _LARGEST_CONDITION * values[0]:
        return None
    lifted = tangent @ vectors[: tangent.shape[1]]
    return np.asarray((lifted / values) @ lifted.T)


def in_theta(game: Game, parameters: np.ndarray) -> np.ndarray:
    """(N*(K+U),) booleans at the places of parameters (N, U) in theta."""
    return np.pad(parameters, [(0, 0), (game.num_weights, 0)]).ravel()


def unobserved_unknowns(
    game: Game, sensitivities: Sequence[np.ndarray], *, sigma: float
) -> np.ndarray:
    """Which unknowns (N, U) the trajectories tell nothing about at a noise level above 0.

    They leave nearly all of the variance of its prior (``UNOBSERVED_ABOVE``). Sensitivities are
    those of ``joint_weight_covariance``.
    """
    if not game.parameters.count:
        return game.parameters.used
    left = identifiability(game, sensitivities, sigma=sigma).parameter_left
    return np.asarray(left > UNOBSERVED_ABOVE)  # NaN compares false


def deviations_of(game: Game, covariance: np.ndarray | None) -> np.ndarray | None:
    """Standard deviations (N, U) of a game's unknowns in their units, NaN where there is none.

    None without a covariance (N*(K+U), N*(K+U)) of theta, or if the game has no unknowns.
    """
    if covariance is None or not game.parameters.count:
        return None
    variances = np.diag(covariance).reshape(game.num_players, -1)[:, game.num_weights :]
    return np.asarray(np.sqrt(variances) * game.parameters.deviations)


def of_weights(game: Game, covariance: np.ndarray | None) -> np.ndarray | None:
    """The part (N*K, N*K) of a covariance of theta that belongs to the weights."""
    if covariance is None:
        return None
    count, own = game.num_weights, game.num_weights + game.parameters.count
    kept = np.arange(len(covariance)) % own < count
    return covariance[np.ix_(kept, kept)]


def identifiability(
    game: Game, sensitivities: Sequence[np.ndarray], *, sigma: float
) -> Identifiability:
    """Which weights the trajectories identify at a noise level above 0.

    The information may be singular. All other weights, unknowns and each trajectory's initial state
    are unknown, too. Sensitivities are those of ``joint_weight_covariance``.
    """
    root = information_root(game, sensitivities)
    return identified_at(root, game.num_weights, game.parameters.used, sigma=sigma)


def information_root(game: Game, sensitivities: Sequence[np.ndarray]) -> np.ndarray:
    """R (F, F), upper triangular: R'R is the information on the tangent of theta for unit noise.

    Each start is unknown. The arguments are those of ``identifiability``.
    """
    tangent = theta_tangent(game.num_weights, game.parameters.used)
    observed, free = _on_tangent(tangent, sensitivities), tangent.shape[1]
    # With the columns of x_1 in front, the weights' block of the triangular factor is the root of
    # their information with x_1 unknown.
    nuisance_first = np.hstack([observed[:, free:], observed[:, :free]])
    _, triangle = np.linalg.qr(nuisance_first)
    return np.asarray(triangle[-free:, -free:])


def cosine_error_limit(covariance: np.ndarray, weights: np.ndarray) -> float:
    """Expected cosine error (eqn. cosine_metric) of an efficient estimator, covariance (N*K, N*K).

    To second order ``E[1 - cos] = mean_i tr(P_i C_i) / (2 |theta_i|^2)`` at true weights (N, K)
    with P_i the projection orthogonal to theta_i.
    """
    count = weights.shape[1]
    errors = []
    for i, theta in enumerate(weights):
        block = covariance[i * count : (i + 1) * count, i * count : (i + 1) * count]
        squared = theta @ theta
        projection = np.eye(count) - np.outer(theta, theta) / squared
        errors.append(np.trace(projection @ block) / (2 * squared))
    return float(np.mean(errors))


def _on_tangent(tangent: np.ndarray, sensitivities: Sequence[np.ndarray]) -> np.ndarray:
    """Derivatives of all expected observations in the tangent's coordinates and all x_1."""
    free = tangent.shape[1]
    starts = sensitivities[0].shape[1] - len(tangent)
    rows = np.cumsum([0, *map(len, sensitivities)])
    observed = np.zeros((rows[-1], free + starts * len(sensitivities)))
    for k, columns in enumerate(sensitivities):
        own = observed[rows[k] : rows[k + 1]]
        own[:, :free] = columns[:, : len(tangent)] @ tangent
        own[:, free + k * starts : free + (k + 1) * starts] = columns[:, len(tangent) :]
    return observed


@lru_cache(maxsize=16)
def _view_jacobian(dynamics: Dynamics, view: View) -> RowFunction:
    """State (n,) -> Jacobian h_x (d, n), column by column."""
    state = ca.SX.sym("x", dynamics.state_size)
    jacobian = ca.densify(ca.jacobian(view.expected(state, dynamics), state))
    return RowFunction(ca.Function("h_x", [state], [jacobian]), None)
