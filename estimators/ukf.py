"""An unscented Kalman filter over weights (LUCIDGames, Le Cleac'h et al. 2021).

From the paper: the unknown weights are the state of a Kalman filter; the unscented transform needs
no derivatives, as each sigma point only plays its forward game; measurements arrive one by one,
and the weights are at hand after each of them.

Where this departs from the paper, and why:

- The paper re-plans a game at every step from a state that it knows. Here one open-loop
  equilibrium is observed from an initial state that nobody knows, so the filter's state is
  augmented by x_1 and the measurement at time t is h(x_t(theta, x_1)) of one game over the whole
  horizon.
- Weights live on a simplex, so the filter sees their log-ratios phi (``estimators.simplex``), with
  the prior phi ~ N(phi_0, spread^2 I) around the weights of the first game.

With the state s = (phi, x_1), constant in time (Wan and van der Merwe 2000; numbers ours):

    (U1)  S_k = m, m +- alpha sqrt(n) columns of chol(P)                     sigma points
    (U2)  z_k = h(x_t(S_k)),  z = sum w_k z_k                                forward games
    (U3)  P_zz = sum w_k (z_k - z)(z_k - z)' + R,  P_sz = sum w_k (S_k - m)(z_k - z)'
    (U4)  m += P_sz P_zz^-1 (y_t - z),  P -= P_sz P_zz^-1 P_sz'
    (U5)  R = sigma^2 I / beta_j, with shares beta_j of the measurement that sum to one

(U5) is ours, after Hanebeck's progressive filtering: a measurement much more precise than the
prediction is taken in by shares, with new sigma points in between, as one large step in a game so
nonlinear would go astray. In a linear problem the shares add up to the plain update.

Sigma points and equations are filterpy's. Where a sigma point has no equilibrium that can be
followed from the mean's, all of them are drawn closer to the mean (a smaller alpha): that is as
valid an unscented transform of the same Gaussian. Where an update takes the mean to a game without
one, a smaller share is taken in; if that does not help the filter has lost its way, and says so.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

from estimators.forward_model import (
    Played,
    expected_samples,
    first_games,
    initial_state_prior,
    played,
    replay,
    scaled_samples,
    squared_error_of,
    uniform_weights,
)
from estimators.protocol import Estimate, Observation, Problem, check_observations
from estimators.simplex import from_log_ratios, log_ratios_of, weight_covariance_of
from estimators.trajectory_fit import warm_up_fit
from games.native import elimination

#: Each time a sigma point has no equilibrium the set shrinks by this factor, so many times at most.
_SHRINK, _MOST_SHRINKS = 0.5, 6

#: Largest ratio of predicted variance to noise that one share of a measurement may have.
_MOST_AT_ONCE = 10.0

#: Into how many shares a measurement is cut at most.
_MOST_SHARES = 40

#: Weights of the first game are at least this share of uniform ones: phi is finite there.
_LEAST_SHARE = 0.1

#: Noise-free data are filtered as if with this standard deviation.
_LEAST_SIGMA = 1e-4

Expected = Callable[[int, np.ndarray], np.ndarray]


class LostError(Exception):
    """The filter cannot go on."""


@dataclass(frozen=True)
class Gaussian:
    """A mean (n,) and a covariance (n, n)."""

    mean: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True)
class Ukf:
    """Filters log-ratios of weights and the initial state, one measurement at a time.

    Attributes:
        spread: prior standard deviation of the log-ratios.
        alpha: distance of the sigma points from the mean, in units of sqrt(n) standard deviations.
    """

    name: ClassVar[str] = "ukf"
    several: ClassVar[bool] = True
    spread: float = 1.0
    alpha: float = 0.5

    def estimate(
        self,
        problem: Problem,
        observation: Observation | Sequence[Observation],
        *,
        rng: np.random.Generator,
        budget: float,
    ) -> Estimate:
        observations = check_observations(problem, observation)
        deadline = time.monotonic() + budget / 2
        count, floor = problem.game.num_weights, problem.weight_floor
        sigma = max(problem.sigma, _LEAST_SIGMA)
        online: list[np.ndarray] = []
        weights: Gaussian | None = None
        first_states, objective = None, 0.0
        try:
            for one in observations:
                start = _first_game(problem, one)
                prior = _prior(problem, one, start, weights, self.spread, sigma)
                forward = FollowedGames(problem, start, deadline)
                samples = scaled_samples(problem, one.y)
                for belief in filter_samples(prior, forward.expected, samples, sigma, self.alpha):
                    online.append(forward.weights(belief.mean))
                end = forward.play(belief.mean)
                objective += squared_error_of(problem, end.root.states, one.y)
                first_states = end.root.states if first_states is None else first_states
                size = forward.num_log_ratios
                weights = Gaussian(belief.mean[:size], belief.covariance[:size, :size])
        except LostError as error:
            last = online[-1] if online else uniform_weights(problem)
            return Estimate(weights=last, converged=False, message=str(error))
        assert weights is not None, "there is at least one observation"
        return Estimate(
            weights=online[-1],
            states=first_states,
            covariance=weight_covariance_of(weights.mean, weights.covariance, count, floor),
            extras={"objective": objective, "online_weights": np.array(online)},
        )

    def warm_up(self, problem: Problem) -> None:
        """Build the solvers."""
        elimination(problem.game, problem.view)
        warm_up_fit(problem.game, problem.view, problem.game.horizon)


def filter_samples(
    prior: Gaussian, expected: Expected, samples: np.ndarray, sigma: float, alpha: float
) -> list[Gaussian]:
    """Filter a constant state through measurements that arrive one by one.

    Args:
        prior: of the state (n,).
        expected: (t, points (B, n)) -> expected measurement (B, d) at time t, a row of NaN for a
            point that has none.
        samples: (T, d) measurements, NaN where missing.
        sigma: standard deviation of their noise.
        alpha: as of ``Ukf``.

    Returns:
        The belief after each of the T measurements.

    Raises:
        LostError: where there is no expected measurement at the mean.
    """
    size = len(prior.mean)
    sets = [_sigma_points(size, alpha * _SHRINK**k) for k in range(_MOST_SHRINKS)]
    kalman = UnscentedKalmanFilter(
        dim_x=size, dim_z=1, dt=1.0, hx=None, fx=lambda state, _: state, points=sets[0]
    )
    kalman.x, kalman.P, kalman.Q = (
        prior.mean.copy(),
        prior.covariance.copy(),
        np.zeros((size, size)),
    )
    beliefs = []
    for t, sample in enumerate(samples):
        seen = np.isfinite(sample)
        if seen.any():
            _take_in(kalman, sets, partial(expected, t), sample, sigma)
        beliefs.append(Gaussian(kalman.x.copy(), kalman.P.copy()))
    return beliefs


def _take_in(
    kalman: UnscentedKalmanFilter,
    sets: list[MerweScaledSigmaPoints],
    expected: Callable[[np.ndarray], np.ndarray],
    sample: np.ndarray,
    sigma: float,
) -> None:
    """(U1) to (U5) for one measurement.

    Raises:
        LostError: where there is no expected measurement at the mean.
    """
    seen, left = np.isfinite(sample), 1.0
    size = int(seen.sum())
    for _ in range(_MOST_SHARES):
        rows = _transformed(kalman, sets, expected)[:, seen]
        centred = rows - kalman.Wm @ rows
        surprise = float(np.linalg.norm(kalman.Wc * centred.T @ centred, 2)) / sigma**2
        share = min(left, _MOST_AT_ONCE / surprise) if surprise > 0 else left
        before = kalman.x.copy(), kalman.P.copy()
        for _ in range(_MOST_SHRINKS):
            kalman.update(sample[seen], R=sigma**2 / share * np.eye(size), hx=_in_turn(rows))
            kalman.P = (kalman.P + kalman.P.T) / 2
            if np.isfinite(expected(kalman.x[None])).all():
                break
            kalman.x, kalman.P = before[0].copy(), before[1].copy()
            share *= _SHRINK
        else:
            raise LostError("no equilibrium where a measurement takes the filter's mean")
        if share >= left:
            return
        left -= share
    raise LostError("a measurement is too precise for the filter to take in")


def _transformed(
    kalman: UnscentedKalmanFilter,
    sets: list[MerweScaledSigmaPoints],
    expected: Callable[[np.ndarray], np.ndarray],
) -> np.ndarray:
    """(U1), (U2): z_k (2n+1, d) of the widest set of sigma points that all have one.

    The filter is left with those sigma points.

    Raises:
        LostError: where there is none at the mean.
    """
    for points in sets:
        rows = expected(points.sigma_points(kalman.x, kalman.P))
        if not np.isfinite(rows[0]).all():
            raise LostError("no equilibrium at the filter's mean")
        if np.isfinite(rows).all():
            kalman.points_fn, kalman.Wm, kalman.Wc = points, points.Wm, points.Wc
            kalman.predict()
            return rows
    raise LostError("no equilibria around the filter's mean")


def _sigma_points(size: int, alpha: float) -> MerweScaledSigmaPoints:
    """Sigma points (U1).

    With this beta the weight of the mean in (U3) is zero and the others are positive, so that no
    covariance can become indefinite, however small alpha is.
    """
    beta = alpha**2 + alpha**-2 - 2
    return MerweScaledSigmaPoints(size, alpha, beta, kappa=0.0, sqrt_method=_upper_root)


def _upper_root(matrix: np.ndarray) -> np.ndarray:
    """R with R'R = matrix, which may be singular to rounding."""
    values, vectors = np.linalg.eigh(matrix)
    return np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T


def _in_turn(rows: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """A measurement function for filterpy, which asks for sigma points in their order."""
    remaining = iter(rows)
    return lambda _: next(remaining)


def _first_game(problem: Problem, observation: Observation) -> Played:
    """The game near the observation to follow others from, not far from uniform weights.

    Raises:
        LostError: where none is found.
    """
    games = first_games(problem, observation)
    central = [game for game in games if game.weights.min() > _LEAST_SHARE / game.weights.shape[1]]
    if not central:
        raise LostError("no equilibrium found near the observation")
    return central[0]


def _prior(
    problem: Problem,
    observation: Observation,
    start: Played,
    weights: Gaussian | None,
    spread: float,
    sigma: float,
) -> Gaussian:
    """Belief before the first measurement; later trajectories start from known weights."""
    if weights is None:
        mean = log_ratios_of(start.weights, problem.weight_floor)
        weights = Gaussian(mean, spread**2 * np.eye(mean.size))
    first, deviation = initial_state_prior(problem, observation, sigma)
    size = len(weights.mean)
    covariance = np.diag(np.concatenate([np.zeros(size), deviation.ravel() ** 2]))
    covariance[:size, :size] = weights.covariance
    return Gaussian(np.concatenate([weights.mean, first.ravel()]), covariance)


class FollowedGames:
    """Expected measurements of points (phi, x_1), each game followed from the mean's last one.

    Attributes:
        num_log_ratios: length of phi, N*(K-1).
    """

    def __init__(self, problem: Problem, start: Played, deadline: float) -> None:
        game = problem.game
        self._deadline = deadline
        self.num_log_ratios = game.num_players * (game.num_weights - 1)
        self._problem, self._start = problem, start

    def weights(self, points: np.ndarray) -> np.ndarray:
        """Weights (..., N, K) of points (..., n)."""
        ratios = points[..., : self.num_log_ratios]
        return from_log_ratios(ratios, self._problem.game.num_weights, self._problem.weight_floor)

    def expected(self, t: int, points: np.ndarray) -> np.ndarray:
        """h(x_t) (B, N*d) of points (B, n) whose first is the mean; NaN without equilibrium.

        Raises:
            LostError: after the deadline.
        """
        if time.monotonic() > self._deadline:
            raise LostError("time limit reached")
        weights, initial_states = self.weights(points), self._initial_states(points)
        batch = replay(self._problem, self._start, weights, initial_states)
        if batch.converged[0]:
            self._start = played(batch, 0, weights[0])
        samples = expected_samples(self._problem, batch.states[:, t : t + 1])[:, 0]
        samples[~batch.converged] = np.nan
        return samples

    def play(self, point: np.ndarray) -> Played:
        """The game at a point (n,).

        Raises:
            LostError: where it has no equilibrium.
        """
        weights = self.weights(point[None])
        batch = replay(self._problem, self._start, weights, self._initial_states(point[None]))
        if not batch.converged[0]:
            raise LostError("no equilibrium at the filter's last mean")
        return played(batch, 0, weights[0])

    def _initial_states(self, points: np.ndarray) -> np.ndarray:
        states = points[:, self.num_log_ratios :]
        return states.reshape(len(points), *self._problem.game.state_shape[1:])
