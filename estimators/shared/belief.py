"""Beliefs over (phi, s, x_1): log-ratios of weights, standardised unknowns and an initial state.

``ukf`` and ``particle`` share the belief before the first measurement and the games at points of
the belief. One open-loop equilibrium over the whole horizon is observed from an unknown initial
state, so a point holds both weights and initial state and is constant in time.

Games are followed from a first one. It is the most probable game given the first samples
(``past_posterior``), and the belief about the weights before that comes from the prior alone.
Filters that peek start from ``first_game`` instead, which all observations determine, and whose
weights are the centre of their prior: data count twice, and their weights after early measurements
depend on later ones.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.estimators.shared.charts import (
    by_log_ratios,
    flat_covariance,
    from_log_ratios,
    log_ratios_of,
)
from olne_bench.estimators.shared.forward_model import (
    SolvedGame,
    expected_samples,
    first_games,
    fitted_game,
    game_of_batch,
    initial_state_prior,
    play_batch,
    sample_sensitivity,
    theta_of,
    uniform_weights,
)
from olne_bench.estimators.shared.white_noise import assumed_sigma
from olne_bench.games.compiled.complementarity import RELAXATION
from olne_bench.games.compiled.elimination import elimination
from olne_bench.games.model.game import Game
from olne_bench.games.solve.batch import Batch
from olne_bench.games.solve.newton import pack

#: Weights of the first game are at least this share of uniform ones, so that phi is finite.
_LEAST_SHARE = 0.1


#: Least distance of a weight from its floor, so that phi is finite.
_LEAST_WEIGHT = 1e-6


#: Residuals of games, relative to the noise: what they leave in positions, some ten times as much,
#: is far below it.
_TOLERANCE = 1e-4


#: Hard constraints: margin times multiplier comes to this share of noise times cost, which leaves a
#: car that keeps its distance some 1e-4 of the noise farther away.
_RELAXED = 1e-5


class LostError(Exception):
    """A filter cannot continue."""


class LateError(LostError):
    """A filter's time is up."""


@dataclass(frozen=True)
class Gaussian:
    """A mean (n,) and a covariance (n, n)."""

    mean: np.ndarray
    covariance: np.ndarray


def hidden_positions(problem: Problem) -> str | None:
    """Why a filter cannot start: a measurement does not determine positions; None if it does.

    The belief about x_1 before the first measurement is read off that measurement.
    """
    dynamics = problem.game.dynamics
    known = problem.view.read_off(np.zeros((1, len(problem.noise_scale))), dynamics)
    if {"px", "py"} <= known.keys():
        return None
    return f"needs a sensor that shows positions; {problem.view.name!r} does not"


def lost_estimate(problem: Problem, online: Sequence[np.ndarray], message: str) -> Estimate:
    """What a filter knew when it could not continue.

    Args:
        problem: what is known.
        online: mean weights (N, K) after each measurement so far.
        message: one line that explains the failure.
    """
    last = online[-1] if len(online) else uniform_weights(problem)
    extras = {"online_weights": np.array(online)}
    return Estimate(weights=last, converged=False, message=message, extras=extras)


def first_game(problem: Problem, observation: Observation) -> SolvedGame:
    """A game near all of the observation, not far from uniform weights, for filters that peek.

    Raises:
        LostError: if none is found.
    """
    fitted = fitted_game(problem, observation)
    if fitted is not None:
        return fitted
    games = first_games(problem, observation)
    central = [game for game in games if game.weights.min() > _LEAST_SHARE / game.weights.shape[1]]
    if not central:
        raise LostError("no equilibrium found near the observation")
    return central[0]


def first_weights(problem: Problem, spread: float, start: SolvedGame | None = None) -> Gaussian:
    """Belief about the log-ratios and unknowns before anything is seen.

    Args:
        problem: what is known.
        spread: standard deviations of the log-ratios, in units of those of weights that are uniform
            on the simplex.
        start: the game at whose log-ratios the mean is, where a filter may peek; uniform weights if
            None.
    """
    game = problem.game
    around = uniform_weights(problem) if start is None else start.weights
    covariance = spread**2 * flat_covariance(game.num_players, game.num_weights)
    unknown = int(game.parameters.used.sum())
    return Gaussian(
        np.concatenate([log_ratios_of(around, problem.weight_floor), np.zeros(unknown)]),
        block_diag(covariance, np.eye(unknown)),
    )


def prior_belief(
    problem: Problem, observation: Observation, weights: Gaussian, sigma: float
) -> Gaussian:
    """Belief before the first measurement.

    Args:
        problem: what is known.
        observation: its first measurements locate x_1.
        weights: belief about the log-ratios and unknowns.
        sigma: noise level.
    """
    first, deviation = initial_state_prior(problem, observation, sigma)
    covariance = block_diag(weights.covariance, np.diag(deviation.ravel() ** 2))
    return Gaussian(np.concatenate([weights.mean, first.ravel()]), covariance)


def unscented_weights(
    log_ratios: np.ndarray, covariance: np.ndarray, num_weights: int, floor: float
) -> Gaussian:
    """Moments of the weights (N*K,) of Gaussian log-ratios (N*(K-1),), player by player."""
    free = num_weights - 1
    size = np.sqrt(free)
    means, slopes, rests = [], [], []
    for k in range(0, len(log_ratios), free):
        own = covariance[k : k + free, k : k + free]
        root = symmetric_root(own)
        steps = size * np.vstack([root, -root])
        rows = from_log_ratios(log_ratios[k : k + free] + steps, num_weights, floor)[:, 0]
        mean = rows.mean(axis=0)
        slope = (rows - mean).T @ steps / len(steps) @ np.linalg.pinv(own, hermitian=True)
        means.append(mean)
        slopes.append(slope)
        rests.append((rows - mean).T @ (rows - mean) / len(steps) - slope @ own @ slope.T)
    slope = block_diag(*slopes)
    return Gaussian(np.concatenate(means), slope @ covariance @ slope.T + block_diag(*rests))


def symmetric_root(matrix: np.ndarray) -> np.ndarray:
    """Symmetric R with RR = matrix, which may be singular to rounding.

    It is unique. Other roots by eigenvectors depend on rounding where eigenvalues are equal.
    """
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)


class FollowedGames:
    """Expected measurements at points (phi, s, x_1); games are followed from the mean's last one.

    Where the game has hard constraints, complementarity (``games.compiled.complementarity``) is
    relaxed as far as the noise hides it. The game then bends where it would have a kink, so that
    Newton's method and derivatives work.

    Attributes:
        problem: what is known.
        start: the game from which the next ones are followed.
        num_log_ratios: length of phi, N*(K-1).
        num_theta: length of (phi, s).
    """

    def __init__(self, problem: Problem, start: SolvedGame, deadline: float) -> None:
        game = problem.game
        self._deadline = deadline
        self.num_log_ratios = game.num_players * (game.num_weights - 1)
        self._used = game.parameters.used
        self.num_theta = self.num_log_ratios + int(self._used.sum())
        self.problem, self.start = problem, start
        sigma = assumed_sigma(problem)
        self._tolerance = _TOLERANCE * sigma
        solver = elimination(game)
        self._solver = solver.relaxed(max(RELAXATION, _RELAXED * sigma * _cost_of(game, start)))

    def point(self, game: SolvedGame) -> np.ndarray:
        """The point (n,) of a game, at weights that are no nearer to their floor than 1e-6."""
        num_weights, floor = self.problem.game.num_weights, self.problem.weight_floor
        shares = np.maximum(game.weights - floor, _LEAST_WEIGHT)
        shares *= (1 - num_weights * floor) / shares.sum(axis=1, keepdims=True)
        parts = [log_ratios_of(floor + shares, floor), game.initial_state.ravel()]
        if game.parameters is not None:
            parts.insert(1, game.parameters[self._used])
        return np.concatenate(parts)

    def weights(self, points: np.ndarray) -> np.ndarray:
        """Weights (..., N, K) of points (..., n)."""
        ratios = points[..., : self.num_log_ratios]
        return from_log_ratios(ratios, self.problem.game.num_weights, self.problem.weight_floor)

    def parameters(self, points: np.ndarray) -> np.ndarray | None:
        """Unknowns (..., N, U) of points (..., n) in their units; None if there are none.

        A Gaussian belief has no bounds: values end at those of their ranges.
        """
        if not self._used.size:
            return None
        known = self.problem.game.parameters
        low, high = known.bounds()
        return known.values(self._standardised(points).clip(low, high))

    def parameter_deviations(self, covariance: np.ndarray) -> np.ndarray | None:
        """Standard deviations (N, U) in their units, of a covariance of (phi, s)."""
        if not self._used.size:
            return None
        found = np.zeros(self._used.shape)
        found[self._used] = np.sqrt(np.diag(covariance)[self.num_log_ratios : self.num_theta])
        return np.asarray(found * self.problem.game.parameters.deviations)

    def mean_weights(self, belief: Gaussian) -> np.ndarray:
        """Mean weights (N, K) of a belief about (phi, s) or (phi, s, x_1)."""
        return self.weight_belief(belief).mean.reshape(-1, self.problem.game.num_weights)

    def weight_belief(self, theta: Gaussian) -> Gaussian:
        """Mean (N*K,) and covariance (N*K, N*K) of the weights, of a belief about (phi, s).

        The unscented transform of each player's log-ratios, whose third-order accuracy counts where
        little is known. Between players, what is linear counts only.
        """
        own = slice(0, self.num_log_ratios)
        return unscented_weights(
            theta.mean[own],
            theta.covariance[own, own],
            self.problem.game.num_weights,
            self.problem.weight_floor,
        )

    def _standardised(self, points: np.ndarray) -> np.ndarray:
        found = np.zeros((*points.shape[:-1], *self._used.shape))
        found[..., self._used] = points[..., self.num_log_ratios : self.num_theta]
        return found

    def _theta(self, points: np.ndarray) -> np.ndarray:
        return theta_of(self.weights(points), self._standardised(points))

    def expected(self, points: np.ndarray) -> np.ndarray:
        """h(x) (B, T, N*d) of points (B, n) whose first is the mean; NaN without equilibrium.

        Raises:
            LateError: after the deadline.
        """
        if time.monotonic() > self._deadline:
            raise LateError("time limit reached")
        theta, initial_states = self._theta(points), self._initial_states(points)
        batch = self._play(theta, initial_states, self._tolerance)
        if batch.converged[0]:
            self.start = game_of_batch(self.problem, batch, 0, theta[0])
        samples = expected_samples(self.problem, batch.states)
        samples[~batch.converged] = np.nan
        return samples

    def tangent(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """h(x) (T, N*d) at a point (n,) and its derivative (T, N*d, n); None without equilibrium.

        Raises:
            LateError: after the deadline.
        """
        try:
            samples = self.expected(point[None])[0]
            if not np.isfinite(samples).all():
                return None
            by_theta = sample_sensitivity(self.problem, self.start, self._solver)
        except ValueError:  # the equilibrium is not a function of the point
            return None
        return samples, self._by_point(by_theta, point).reshape(*samples.shape, -1)

    def _by_point(self, derivative: np.ndarray, point: np.ndarray) -> np.ndarray:
        """A derivative in (theta, x_1), by the chain rule one in (phi, s, x_1)."""
        players, weights = self.start.weights.shape
        own = self.start.theta.shape[1]
        by_theta = derivative[:, : players * own].reshape(len(derivative), players, own)
        by_weights = by_theta[:, :, :weights].reshape(len(derivative), -1)
        by_phi = by_weights @ by_log_ratios(
            point[: self.num_log_ratios], weights, self.problem.weight_floor
        )
        unknown = by_theta[:, :, weights:][:, self._used] if self._used.size else by_phi[:, :0]
        return np.hstack([by_phi, unknown, derivative[:, players * own :]])

    def play(self, point: np.ndarray) -> SolvedGame:
        """The game at a point (n,).

        Raises:
            LostError: if it has no equilibrium.
        """
        theta = self._theta(point[None])
        batch = self._play(theta, self._initial_states(point[None]))
        if not batch.converged[0]:
            raise LostError("no equilibrium at the filter's last mean")
        return game_of_batch(self.problem, batch, 0, theta[0])

    def _play(
        self, theta: np.ndarray, initial_states: np.ndarray, tolerance: float = 1e-10
    ) -> Batch:
        return play_batch(
            self.problem,
            self.start,
            theta,
            initial_states,
            tolerance=tolerance,
            solver=self._solver,
        )

    def _initial_states(self, points: np.ndarray) -> np.ndarray:
        states = points[:, self.num_theta :]
        return states.reshape(len(points), *self.problem.game.state_shape[1:])


def _cost_of(game: Game, played: SolvedGame) -> float:
    """Sum of the players' costs, each by its size."""
    root = played.root
    z = pack(game, root.states, root.controls, root.costates, played.theta)
    return float(np.abs(elimination(game).costs(z, played.theta.ravel())).sum())
