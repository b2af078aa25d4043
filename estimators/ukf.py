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

    (U1)  S_k = m, m +- alpha sqrt(n) columns of P^(1/2)                     sigma points
    (U2)  z_kr = h(x_r(S_k)) for all times r                                 forward games
    (U3)  z_r + A_r (s - m) with a rest of covariance O_r:                   regression
          z_r = sum w_k z_kr,  A_r = P_zs P^-1,  O_r = P_zz - A_r P A_r'
    (U4)  Kalman update with y_t = z_t + A_t (s - m) + noise of covariance O_t + R
    (U5)  R = sigma^2 I / beta_j, with shares beta_j of the measurement that sum to one
    (U6)  new sigma points only where (U3) does not hold any more

(U3) and (U4) are the unscented update: with the gain P_sz (P_zz + R)^-1 written out, both are the
same (statistical linear regression: Lefebvre, Bruyninckx and De Schutter 2002).

(U5) is ours, after Hanebeck's progressive filtering: a measurement much more precise than the
prediction is used in shares, because one large step would fail in such a nonlinear game. In a
linear problem the shares add up to the plain update.

(U6) is ours as well: a game predicts all measurements, so one set of sigma points serves several
of them, and several shares. The game at the new mean is played after every update, and replaces the
prediction there. The slopes A_r serve on while that game agrees with them to within the noise, and
either no variance of P has fallen far or the rest O_r is small beside the noise. A linear problem
needs one set.

Sigma points are those of filterpy. If a sigma point has no equilibrium that can be followed from
the mean's, all of them are moved closer to the mean (a smaller alpha), which is an equally valid
unscented transform of the same Gaussian. If an update moves the mean to a game without an
equilibrium, a smaller share is used; if that does not help, the estimate fails.

Paper: LUCIDGames, Le Cleac'h et al. 2021; unscented transform of Wan and van der Merwe 2000.
Assumes: a Gaussian belief in log-ratios of weights, and a known noise level.
Cost: 0.1 s for two players, 0.6 s for five, 0.2 to 0.6 s on roads.
Trust: at high noise, where its prior keeps it from extreme weights, and online. Its error does not
    vanish with the noise; with range and bearing it sometimes fails.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints
from scipy.linalg import eigh

from olne_bench.checks import check_number
from olne_bench.estimators.belief import (
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
from olne_bench.estimators.white_noise import assumed_sigma, white_problem, with_white_noise

#: Factor by which the set shrinks if a sigma point has no equilibrium, and how often at most.
_SHRINK, _MOST_SHRINKS = 0.5, 12

#: Largest ratio, for one share of a measurement, of the variance that its update removes to the
#: variance of its noise, where the measurement is not nearly linear over the belief.
_MOST_AT_ONCE = 3.0

#: (U6): least share of a variance of P that must be left; largest part of a measurement's variance
#: that may not be linear, and largest squared error of its prediction, both in the noise's unit.
_NARROWED, _BENT, _DRIFT = 0.5, 0.05, 0.1

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
        deadline = time.monotonic() + budget
        sigma = assumed_sigma(problem)
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
                size = forward.num_theta
                weights = Gaussian(belief.mean[:size], belief.covariance[:size, :size])
        except LostError as error:
            last = online[-1] if online else uniform_weights(problem)
            return Estimate(weights=last, converged=False, message=str(error))
        assert weights is not None, "there is at least one observation"
        return Estimate(
            weights=online[-1],
            states=first_states,
            covariance=forward.weight_covariance(weights),
            parameters=forward.parameters(weights.mean),
            parameter_deviations=forward.parameter_deviations(weights.covariance),
            extras={"objective": objective, "online_weights": np.array(online)},
        )

    def supports(self, problem: Problem) -> str | None:
        """Why this problem cannot be filtered, or None."""
        return hidden_positions(problem)

    def warm_up(self, problem: Problem) -> None:
        """Build the solvers."""
        problem = white_problem(problem)
        warm_up_games(problem)


@dataclass(frozen=True)
class Regression:
    """(U3): expected measurements at all times, linear around a belief.

    Attributes:
        belief: the belief (m, P).
        centre: (T, d) expected measurements at m.
        mean: (T, d) their mean z under the belief.
        slopes: (T, d, n) A.
        bends: (T, d, n) columns whose products with themselves are the covariance of the rest.
    """

    belief: Gaussian
    centre: np.ndarray
    mean: np.ndarray
    slopes: np.ndarray
    bends: np.ndarray

    def rest(self, t: int, seen: np.ndarray) -> np.ndarray:
        """Covariance of what is not linear in the measurements seen at t."""
        bends = self.bends[t, seen]
        return np.asarray(bends @ bends.T)

    def serves(
        self, belief: Gaussian, centre: np.ndarray, t: int, seen: np.ndarray, sigma: float
    ) -> bool:
        """(U6): whether the slopes hold for another belief, with (T, d) expected at its mean."""
        if belief is self.belief:
            return True
        moved = self.slopes[t, seen] @ (belief.mean - self.belief.mean)
        drift = centre[t, seen] - self.centre[t, seen] - moved
        rest = self.rest(t, seen)
        if np.sum(drift**2) > _DRIFT * len(drift) * sigma**2:
            return False
        if np.linalg.eigvalsh(rest)[-1] <= _BENT * sigma**2:
            return True
        values = eigh(belief.covariance, self.belief.covariance, eigvals_only=True)
        return bool(values[0] >= _NARROWED)


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
    run = _Filter(prior, expected, sigma, alpha)
    beliefs = []
    for t, sample in enumerate(samples):
        if np.isfinite(sample).any():
            run.take_in(t, sample)
        beliefs.append(run.belief)
    return beliefs


class _Filter:
    """A belief, the expected measurements (T, d) at its mean, and the last set of sigma points."""

    def __init__(self, prior: Gaussian, expected: Expected, sigma: float, alpha: float) -> None:
        self.belief, self._expected, self._sigma = prior, expected, sigma
        size = len(prior.mean)
        self._sets = [_sigma_points(size, alpha * _SHRINK**k) for k in range(_MOST_SHRINKS)]
        self._regression = self._regressed()
        self._centre = self._regression.centre

    def take_in(self, t: int, sample: np.ndarray) -> None:
        """(U1) to (U6) for one measurement.

        Raises:
            LostError: if there is no equilibrium at the mean, or the shares become too small.
        """
        seen, left = np.isfinite(sample), 1.0
        for _ in range(_MOST_SHARES):
            if not self._regression.serves(self.belief, self._centre, t, seen, self._sigma):
                self._regression = self._regressed()
                self._centre = self._regression.centre
            share = min(left, _largest_share(self._regression, self.belief, t, seen, self._sigma))
            share = self._use(share, t, sample, seen)
            if share >= left:
                return
            left -= share
        raise LostError("a measurement is too precise for the filter to take in")

    def _use(self, share: float, t: int, sample: np.ndarray, seen: np.ndarray) -> float:
        """(U4) with a share of a measurement, or as much of it as leads to a game; what was used.

        Raises:
            LostError: if nothing of it does.
        """
        regression = self._regression
        bend = regression.mean[t, seen] - regression.centre[t, seen]
        slopes, rest = regression.slopes[t, seen], regression.rest(t, seen)
        for _ in range(_MOST_SHRINKS):
            noise = rest + self._sigma**2 / share * np.eye(len(slopes))
            new = _updated(self.belief, sample[seen] - self._centre[t, seen] - bend, slopes, noise)
            (centre,) = self._expected(new.mean[None])
            if np.isfinite(centre).all():
                self.belief, self._centre = new, centre
                return share
            share *= _SHRINK
        raise LostError("no equilibrium where a measurement takes the filter's mean")

    def _regressed(self) -> Regression:
        """(U1) to (U3) with the widest set of sigma points that all have a game.

        Raises:
            LostError: if the mean has no equilibrium.
        """
        belief = self.belief
        for points in self._sets:
            rows = self._expected(points.sigma_points(belief.mean, belief.covariance))
            if not np.isfinite(rows[0]).all():
                raise LostError("no equilibrium at the filter's mean")
            if np.isfinite(rows).all():
                return _regression(belief, points, rows)
        raise LostError("no equilibria around the filter's mean")


def _regression(belief: Gaussian, points: MerweScaledSigmaPoints, rows: np.ndarray) -> Regression:
    """(U3) of expected measurements (2n+1, T, d)."""
    mean = np.tensordot(points.Wm, rows, axes=1)
    ahead, behind = np.split(rows[1:], 2)
    size = np.sqrt(2 * points.Wc[1])
    odd, even = size * (ahead - behind) / 2, size * ((ahead + behind) / 2 - mean)
    # The columns of the root are the changes to which the rows belong.
    inverse = np.linalg.pinv(_symmetric_root(belief.covariance), hermitian=True)
    return Regression(
        belief,
        rows[0],
        mean,
        slopes=np.einsum("ktd,kn->tdn", odd, inverse),
        bends=np.moveaxis(even, 0, -1),
    )


def _updated(
    belief: Gaussian, error: np.ndarray, slopes: np.ndarray, noise: np.ndarray
) -> Gaussian:
    """(U4): the belief after a linear measurement; Joseph's form keeps the covariance definite."""
    crossed = belief.covariance @ slopes.T
    gain = np.linalg.solve(slopes @ crossed + noise, crossed.T).T
    kept = np.eye(len(belief.mean)) - gain @ slopes
    covariance = kept @ belief.covariance @ kept.T + gain @ noise @ gain.T
    return Gaussian(belief.mean + gain @ error, (covariance + covariance.T) / 2)


def _largest_share(
    regression: Regression, belief: Gaussian, t: int, seen: np.ndarray, sigma: float
) -> float:
    """Largest share of a measurement that is not too precise.

    An update removes the part of the prediction's variance that is linear in the state. The rest
    acts as noise of the measurement. Where the rest is far below the noise, any share will do.
    """
    slopes, rest = regression.slopes[t, seen], regression.rest(t, seen)
    variances, directions = np.linalg.eigh(slopes @ belief.covariance @ slopes.T)
    along = float(directions[:, -1] @ rest @ directions[:, -1])
    excess = variances[-1] - _MOST_AT_ONCE * along
    largest = float(np.linalg.eigvalsh(rest)[-1])
    straight = _BENT * sigma**2 / largest if largest > 0 else np.inf
    return max(straight, _MOST_AT_ONCE * sigma**2 / excess) if excess > 0 else np.inf


def _sigma_points(size: int, alpha: float) -> MerweScaledSigmaPoints:
    """Sigma points (U1).

    With this beta the weight of the mean in (U3) is zero and the others are positive, so that no
    covariance can become indefinite, however small alpha is.
    """
    beta = alpha**2 + alpha**-2 - 2
    return MerweScaledSigmaPoints(size, alpha, beta, kappa=0.0, sqrt_method=_symmetric_root)


def _symmetric_root(matrix: np.ndarray) -> np.ndarray:
    """Symmetric R with RR = matrix, which may be singular to rounding.

    It is unique. Other roots by eigenvectors depend on rounding where eigenvalues are equal.
    """
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)
