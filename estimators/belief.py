"""Beliefs over (phi, x_1), log-ratios of weights and an initial state, for filters.

``ukf`` and ``particle`` share the belief before the first measurement and the games at points of
the belief. One open-loop equilibrium over the whole horizon is observed from an unknown initial
state, so a point holds both weights and initial state and is constant in time.

Games are followed from a first one. It is found from all observations with weights tied to uniform,
and the belief about the weights starts around it. A filter that starts from uniform weights and the
first measurement of x_1 does not reach the equilibria of five players: the equilibria near uniform
weights end at folds on the way. Hence a filter's weights after early measurements depend on later
ones, which determine its start but not its steps.
"""

import time
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from olne_bench.estimators.forward_model import (
    SolvedGame,
    expected_samples,
    first_games,
    fitted_game,
    game_of_batch,
    initial_state_prior,
    play_batch,
)
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.simplex import flat_covariance, from_log_ratios, log_ratios_of

#: Standard deviation with which noise-free data are filtered.
LEAST_SIGMA = 1e-4

#: Weights of the first game are at least this share of uniform ones, so that phi is finite.
_LEAST_SHARE = 0.1


class LostError(Exception):
    """A filter cannot continue."""


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


def first_game(problem: Problem, observation: Observation) -> SolvedGame:
    """A game near the observation from which others are followed, not far from uniform weights.

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


def prior_belief(
    problem: Problem,
    observation: Observation,
    start: SolvedGame,
    weights: Gaussian | None,
    spread: float,
    sigma: float,
) -> Gaussian:
    """Belief before the first measurement.

    Args:
        problem: what is known.
        observation: its first measurements locate x_1.
        start: the game from which others are followed.
        weights: belief about the log-ratios after earlier trajectories; if None, a Gaussian around
            those of the start.
        spread: standard deviations of that Gaussian, in units of those of weights that are uniform
            on the simplex.
        sigma: noise level.
    """
    first, deviation = initial_state_prior(problem, observation, sigma)
    if weights is None:
        covariance = spread**2 * flat_covariance(problem.game.num_players, problem.game.num_weights)
        weights = Gaussian(log_ratios_of(start.weights, problem.weight_floor), covariance)
    covariance = block_diag(weights.covariance, np.diag(deviation.ravel() ** 2))
    return Gaussian(np.concatenate([weights.mean, first.ravel()]), covariance)


class FollowedGames:
    """Expected measurements at points (phi, x_1); games are followed from the mean's last one.

    Attributes:
        num_log_ratios: length of phi, N*(K-1).
    """

    def __init__(self, problem: Problem, start: SolvedGame, deadline: float) -> None:
        game = problem.game
        self._deadline = deadline
        self.num_log_ratios = game.num_players * (game.num_weights - 1)
        self._problem, self._start = problem, start

    def weights(self, points: np.ndarray) -> np.ndarray:
        """Weights (..., N, K) of points (..., n)."""
        ratios = points[..., : self.num_log_ratios]
        return from_log_ratios(ratios, self._problem.game.num_weights, self._problem.weight_floor)

    def expected(self, points: np.ndarray) -> np.ndarray:
        """h(x) (B, T, N*d) of points (B, n) whose first is the mean; NaN without equilibrium.

        Raises:
            LostError: after the deadline.
        """
        if time.monotonic() > self._deadline:
            raise LostError("time limit reached")
        weights, initial_states = self.weights(points), self._initial_states(points)
        batch = play_batch(self._problem, self._start, weights, initial_states)
        if batch.converged[0]:
            self._start = game_of_batch(batch, 0, weights[0])
        samples = expected_samples(self._problem, batch.states)
        samples[~batch.converged] = np.nan
        return samples

    def play(self, point: np.ndarray) -> SolvedGame:
        """The game at a point (n,).

        Raises:
            LostError: if it has no equilibrium.
        """
        weights = self.weights(point[None])
        batch = play_batch(self._problem, self._start, weights, self._initial_states(point[None]))
        if not batch.converged[0]:
            raise LostError("no equilibrium at the filter's last mean")
        return game_of_batch(batch, 0, weights[0])

    def _initial_states(self, points: np.ndarray) -> np.ndarray:
        states = points[:, self.num_log_ratios :]
        return states.reshape(len(points), *self._problem.game.state_shape[1:])
