"""An unscented Kalman filter over weights (LUCIDGames, Le Cleac'h et al. 2021).

From the paper: the unknown weights are the state of a Kalman filter; the unscented transform needs
no derivatives, as each sigma point only needs its forward game; measurements arrive one by one,
and the weights are available after each of them.

Where this departs from the paper, and why:

- The paper re-plans a game at every step from a state that it knows. Here one open-loop
  equilibrium is observed from an unknown initial state, so the filter's state is
  augmented by x_1 and the measurement at time t is h(x_t(theta, x_1)) of one game over the whole
  horizon.
- Weights live on a simplex, so the filter sees their log-ratios phi (``estimators.simplex``), with
  a Gaussian prior around those of a first game that explains the observations with weights tied to
  uniform. Its covariance is that of a uniform distribution on the simplex times spread^2. A filter
  that starts at uniform weights does not reach the equilibria of five players: those near uniform
  weights end on the way.

With the state s = (phi, x_1), constant in time (Wan and van der Merwe 2000; numbers ours):

    (U1)  S_k = m, m +- alpha sqrt(n) columns of chol(P)                     sigma points
    (U2)  z_k = h(x_t(S_k)),  z = sum w_k z_k                                forward games
    (U3)  P_zz = sum w_k (z_k - z)(z_k - z)' + R,  P_sz = sum w_k (S_k - m)(z_k - z)'
    (U4)  m += P_sz P_zz^-1 (y_t - z),  P -= P_sz P_zz^-1 P_sz'
    (U5)  R = sigma^2 I / beta_j, with shares beta_j of the measurement that sum to one

(U5) is ours, after Hanebeck's progressive filtering: a measurement much more precise than the
prediction is used in shares, with new sigma points for each, because one large step would fail in
such a nonlinear game. In a linear problem the shares add up to the plain update.

Sigma points and update equations are those of filterpy. If a sigma point has no equilibrium that
can be followed from the mean's, all of them are moved closer to the mean (a smaller alpha), which
is an equally valid unscented transform of the same Gaussian. If an update moves the mean to a game
without an equilibrium, a smaller share is used; if that does not help, the estimate fails.

Paper: LUCIDGames, Le Cleac'h et al. 2021; unscented transform of Wan and van der Merwe 2000.
Assumes: a Gaussian belief in log-ratios of weights, and a known noise level.
Cost: 0.15 s for two players, 0.8 s for five, 2 s on roads, sometimes several times as much.
Trust: at high noise, where its prior keeps it from extreme weights, and online. Its error does not
    vanish with the noise; with range and bearing it sometimes fails.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

from olne_bench.checks import check_number
from olne_bench.estimators.belief import (
    LEAST_SIGMA,
    FollowedGames,
    Gaussian,
    LostError,
    first_game,
    hidden_positions,
    prior_belief,
)
from olne_bench.estimators.forward_model import (
    scaled_samples,
    squared_error_of,
    uniform_weights,
    warm_up_games,
)
from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.estimators.simplex import weight_covariance_of
from olne_bench.estimators.white_noise import white_problem, with_white_noise

#: Factor by which the set shrinks if a sigma point has no equilibrium, and how often at most.
_SHRINK, _MOST_SHRINKS = 0.5, 12

#: Largest ratio, for one share of a measurement, of the variance that its update removes to the
#: variance of its noise.
_MOST_AT_ONCE = 1.0

#: Largest number of shares of a measurement.
_MOST_SHARES = 200

Expected = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Ukf:
    """Filters log-ratios of weights and the initial state, one measurement at a time.

    Attributes:
        spread: prior standard deviation of the log-ratios, in units of that of weights that are
            uniform on the simplex.
        alpha: distance of the sigma points from the mean, in units of sqrt(n) standard deviations.

    Raises:
        ValueError: on a parameter out of range.
    """

    name: ClassVar[str] = "ukf"
    several: ClassVar[bool] = True
    spread: float = 0.5
    alpha: float = 0.5

    def __post_init__(self) -> None:
        check_number("spread", self.spread)
        check_number("alpha", self.alpha)

    def estimate(
        self,
        problem: Problem,
        observation: Observation | Sequence[Observation],
        *,
        rng: np.random.Generator,
        budget: float,
    ) -> Estimate:
        problem, observations = with_white_noise(problem, observation)
        deadline = time.monotonic() + budget / 2
        count, floor = problem.game.num_weights, problem.weight_floor
        sigma = max(problem.sigma, LEAST_SIGMA)
        online: list[np.ndarray] = []
        weights: Gaussian | None = None
        first_states, objective = None, 0.0
        try:
            for one in observations:
                start = first_game(problem, one)
                prior = prior_belief(problem, one, start, weights, self.spread, sigma)
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

    def supports(self, problem: Problem) -> str | None:
        """Why this problem cannot be filtered, or None."""
        return hidden_positions(problem)

    def warm_up(self, problem: Problem) -> None:
        """Build the solvers."""
        problem = white_problem(problem)
        warm_up_games(problem)


def filter_samples(
    prior: Gaussian, expected: Expected, samples: np.ndarray, sigma: float, alpha: float
) -> list[Gaussian]:
    """Filter a constant state through measurements that arrive one by one.

    Args:
        prior: belief about the state (n,) before the measurements.
        expected: points (B, n) -> expected measurements (B, T, d), NaN for a point that has none.
        samples: (T, d) measurements, NaN where missing.
        sigma: standard deviation of their noise.
        alpha: as in ``Ukf``.

    Returns:
        The belief after each of the T measurements.

    Raises:
        LostError: if there is no expected measurement at the mean.
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
            _take_in(kalman, sets, partial(_expected_at, expected, t), sample, sigma)
        beliefs.append(Gaussian(kalman.x.copy(), kalman.P.copy()))
    return beliefs


def _expected_at(expected: Expected, t: int, points: np.ndarray) -> np.ndarray:
    return expected(points)[:, t]


def _take_in(
    kalman: UnscentedKalmanFilter,
    sets: list[MerweScaledSigmaPoints],
    expected: Expected,
    sample: np.ndarray,
    sigma: float,
) -> None:
    """(U1) to (U5) for one measurement.

    Raises:
        LostError: if there is no expected measurement at the mean, or the shares become too small.
    """
    seen, left = np.isfinite(sample), 1.0
    size = int(seen.sum())
    for _ in range(_MOST_SHARES):
        rows = _transformed(kalman, sets, expected)[:, seen]
        share = min(left, _largest_share(kalman, rows, sigma))
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


def _largest_share(kalman: UnscentedKalmanFilter, rows: np.ndarray, sigma: float) -> float:
    """Largest share of a measurement, with expected rows (2n+1, d), that is not too precise.

    An update removes the part of the prediction's variance that is linear in the state, odd under
    reflection at the mean. The rest acts as noise of the measurement.
    """
    ahead, behind = np.split(rows[1:], 2)
    odd, even = (ahead - behind) / 2, (ahead + behind) / 2 - kalman.Wm @ rows
    weight = 2 * kalman.Wc[1]
    variances, directions = np.linalg.eigh(weight * odd.T @ odd)
    rest = weight * float(np.sum((even @ directions[:, -1]) ** 2))
    excess = variances[-1] - _MOST_AT_ONCE * rest
    return _MOST_AT_ONCE * sigma**2 / excess if excess > 0 else np.inf


def _transformed(
    kalman: UnscentedKalmanFilter,
    sets: list[MerweScaledSigmaPoints],
    expected: Expected,
) -> np.ndarray:
    """(U1), (U2): z_k (2n+1, d) of the widest set of sigma points that all have one.

    The filter then has these sigma points.

    Raises:
        LostError: if the mean has no equilibrium.
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
