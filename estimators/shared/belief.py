"""Beliefs over (z, x_1), coordinates of weights and unknowns (``charts``) and an initial state.

``ukf`` and ``particle`` share the belief before the first measurement and the games at points of
the belief. One open-loop equilibrium over the whole horizon is observed, so a point is constant in
time. Games are followed from the most probable one given the first samples (``past_posterior``).
Filters that peek start from ``first_game`` instead, which all observations determine, and whose
weights are the centre of their prior: data count twice.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np
from numpy.polynomial.hermite_e import hermegauss
from scipy.linalg import block_diag

from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.estimators.shared.charts import NormalChart
from olne_bench.estimators.shared.forward_model import (
    SolvedGame,
    expected_samples,
    first_games,
    fitted_game,
    game_of_batch,
    initial_state_prior,
    play_batch,
    sample_sensitivity,
    uniform_weights,
)
from olne_bench.estimators.shared.white_noise import assumed_sigma
from olne_bench.games.compiled.complementarity import RELAXATION
from olne_bench.games.compiled.elimination import elimination
from olne_bench.games.model.game import Game
from olne_bench.games.solve.batch import Batch
from olne_bench.games.solve.newton import pack

#: Weights of the first game are at least this share of uniform ones.
_LEAST_SHARE = 0.1


#: Residuals of games, relative to the noise: what they leave in positions, some ten times as much,
#: is far below it.
_TOLERANCE = 1e-4


#: Hard constraints: margin times multiplier comes to this share of noise times cost, which leaves a
#: car that keeps its distance some 1e-4 of the noise farther away.
_RELAXED = 1e-5


#: Points of the quadrature of weights in each direction.
_NODES = 5


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
    """Why a filter cannot start (a measurement does not determine positions); None if it can."""
    dynamics = problem.game.dynamics
    known = problem.view.read_off(np.zeros((1, len(problem.noise_scale))), dynamics)
    if {"px", "py"} <= known.keys():
        return None
    return f"needs a sensor that shows positions; {problem.view.name!r} does not"


def lost_estimate(problem: Problem, online: Sequence[np.ndarray], message: str) -> Estimate:
    """What a filter knew when it failed: weights (N, K) after each measurement so far, and why."""
    last = online[-1] if len(online) else uniform_weights(problem)
    extras = {"online_weights": np.array(online)}
    return Estimate(weights=last, converged=False, message=message, extras=extras)


def first_game(problem: Problem, observation: Observation) -> SolvedGame:
    """A game near all samples and uniform weights, for filters that peek; LostError if none."""
    fitted = fitted_game(problem, observation)
    if fitted is not None:
        return fitted
    games = first_games(problem, observation)
    central = [game for game in games if game.weights.min() > _LEAST_SHARE / game.weights.shape[1]]
    if not central:
        raise LostError("no equilibrium found near the observation")
    return central[0]


def first_weights(problem: Problem, spread: float, start: SolvedGame | None = None) -> Gaussian:
    """Belief about the coordinates of weights and unknowns before anything is seen.

    Their standard deviation is ``spread``; that of the problem's prior is one. A filter that peeks
    begins around the game ``start``.
    """
    chart = NormalChart.of(problem)
    mean = np.zeros(chart.size) if start is None else chart.point(start.theta)
    deviations = np.ones(chart.size)
    deviations[: chart.free] = spread
    return Gaussian(mean, np.diag(deviations**2))


def prior_belief(
    problem: Problem, observation: Observation, weights: Gaussian, sigma: float
) -> Gaussian:
    """Belief before the first measurement: about weights, and about x_1 from first measurements."""
    first, deviation = initial_state_prior(problem, observation, sigma)
    covariance = block_diag(weights.covariance, np.diag(deviation.ravel() ** 2))
    return Gaussian(np.concatenate([weights.mean, first.ravel()]), covariance)


def moments_of_weights(mean: np.ndarray, covariance: np.ndarray, chart: NormalChart) -> Gaussian:
    """Moments of weights (N*K,) of Gaussian coordinates (N*(K-1),), by Gauss-Hermite quadrature."""
    free = chart.num_weights - 1
    steps, shares = _quadrature(free)
    means, slopes, rests = [], [], []
    for i, k in enumerate(range(0, len(mean), free)):
        own = covariance[k : k + free, k : k + free]
        moves = steps @ symmetric_root(own)
        points = np.repeat(mean[None], len(moves), axis=0)
        points[:, k : k + free] += moves
        rows = chart.weights(points)[:, i]
        centre = shares @ rows
        away = rows - centre
        slope = (away.T * shares) @ moves @ np.linalg.pinv(own, hermitian=True)
        means.append(centre)
        slopes.append(slope)
        rests.append((away.T * shares) @ away - slope @ own @ slope.T)
    slope = block_diag(*slopes)
    return Gaussian(np.concatenate(means), slope @ covariance @ slope.T + block_diag(*rests))


@lru_cache(maxsize=16)
def _quadrature(free: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (M, free) of a standard normal distribution, and their shares (M,)."""
    nodes, factors = hermegauss(_NODES)
    steps = np.array(list(product(nodes, repeat=free)))
    shares = np.array([np.prod(one) for one in product(factors, repeat=free)])
    return steps, shares / shares.sum()


def symmetric_root(matrix: np.ndarray) -> np.ndarray:
    """The symmetric R with RR = matrix, unique; others depend on rounding at equal eigenvalues."""
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)


class FollowedGames:
    """Expected measurements at points (z, x_1); games are followed from the mean's last one.

    Where the game has hard constraints, complementarity (``games.compiled.complementarity``) is
    relaxed as far as the noise hides it. The game then bends where it would have a kink, so that
    Newton's method and derivatives work.
    """

    def __init__(self, problem: Problem, start: SolvedGame, deadline: float) -> None:
        game = problem.game
        self._deadline = deadline
        self.problem, self.start, self.chart = problem, start, NormalChart.of(problem)
        sigma = assumed_sigma(problem)
        self._tolerance = _TOLERANCE * sigma
        solver = elimination(game)
        self._solver = solver.relaxed(max(RELAXATION, _RELAXED * sigma * _cost_of(game, start)))

    def point(self, game: SolvedGame) -> np.ndarray:
        """The point (n,) of a game."""
        return np.concatenate([self.chart.point(game.theta), game.initial_state.ravel()])

    def weights(self, points: np.ndarray) -> np.ndarray:
        """Weights (..., N, K) of points (..., n)."""
        return self.chart.weights(points)

    def tilt(self, points: np.ndarray) -> np.ndarray:
        """Log (...) of the prior's density over the standard normal one, at points (..., n)."""
        return self.chart.tilt(points)

    def parameters(self, points: np.ndarray) -> np.ndarray | None:
        """Unknowns (..., N, U) of points (..., n) in their units; None if there are none."""
        known = self.problem.game.parameters
        return known.values(self.chart.standardised(points)) if known.count else None

    def parameter_deviations(self, belief: Gaussian) -> np.ndarray | None:
        """Standard deviations (N, U) in their units, of a belief about z."""
        known = self.problem.game.parameters
        if not known.count:
            return None
        shape = known.used.shape[0], -1, self.chart.size
        slopes = self.chart.jacobian(belief.mean).reshape(shape)[:, self.chart.num_weights :]
        variances = np.einsum("nui,ij,nuj->nu", slopes, belief.covariance, slopes)
        return np.asarray(np.sqrt(variances) * np.where(known.used, known.deviations, 0.0))

    def mean_weights(self, belief: Gaussian) -> np.ndarray:
        """Mean weights (N, K) of a belief about z or (z, x_1)."""
        return self.weight_belief(belief).mean.reshape(-1, self.problem.game.num_weights)

    def weight_belief(self, belief: Gaussian) -> Gaussian:
        """Mean (N*K,) and covariance (N*K, N*K) of the weights, of a belief about z.

        Each player's own are exact to a high order; between players, what is linear counts only.
        """
        own = slice(0, self.chart.free)
        return moments_of_weights(belief.mean[own], belief.covariance[own, own], self.chart)

    def expected(self, points: np.ndarray) -> np.ndarray:
        """h(x) (B, T, N*d) of points (B, n), the mean first, NaN without equilibrium.

        Raises LateError after the deadline.
        """
        if time.monotonic() > self._deadline:
            raise LateError("time limit reached")
        theta, initial_states = self.chart.theta(points), self._initial_states(points)
        batch = self._play(theta, initial_states, self._tolerance)
        if batch.converged[0]:
            self.start = game_of_batch(self.problem, batch, 0, theta[0])
        samples = expected_samples(self.problem, batch.states)
        samples[~batch.converged] = np.nan
        return samples

    def tangent(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """h(x) (T, N*d) at a point (n,) and its derivative (T, N*d, n); None where there is none.

        So it is without equilibrium, and so far from the prior that its density is zero in double
        precision. Raises LateError after the deadline.
        """
        try:
            samples = self.expected(point[None])[0]
            if not np.isfinite(samples).all():
                return None
            by_theta = sample_sensitivity(self.problem, self.start, self._solver)
        except ValueError:  # the equilibrium is not a function of the point
            return None
        with np.errstate(all="ignore"):
            by_point = self._by_point(by_theta, point).reshape(*samples.shape, -1)
        return (samples, by_point) if np.isfinite(by_point).all() else None

    def _by_point(self, derivative: np.ndarray, point: np.ndarray) -> np.ndarray:
        """A derivative in (theta, x_1), by the chain rule one in (z, x_1)."""
        by_theta, by_start = np.split(derivative, [self.start.theta.size], axis=1)
        return np.hstack([by_theta @ self.chart.jacobian(point), by_start])

    def play(self, point: np.ndarray) -> SolvedGame:
        """The game at a point (n,); LostError if it has no equilibrium."""
        theta = self.chart.theta(point[None])
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
        states = points[:, self.chart.size :]
        return states.reshape(len(points), *self.problem.game.state_shape[1:])


def _cost_of(game: Game, played: SolvedGame) -> float:
    """Sum of the players' costs, each by its size."""
    root = played.root
    z = pack(game, root.states, root.controls, root.costates, played.theta)
    return float(np.abs(elimination(game).costs(z, played.theta.ravel())).sum())
