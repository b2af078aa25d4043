"""An unscented Kalman filter over weights (LUCIDGames, Le Cleac'h et al. 2021).

In the paper, the unknown weights are the state of a Kalman filter; each sigma point only needs its
forward game, and the weights are available after each measurement. Here:

- one open-loop equilibrium is observed from an unknown initial state, so the state holds x_1 too,
  and the measurement at time t is h(x_t(theta, x_1)) of one game over the whole horizon; the paper
  re-plans a game at every step from a state that it knows.
- weights are seen in coordinates z in which the problem's prior is standard normal
  (``estimators.shared.charts``).
- the filter begins at the most probable game given the first quarter of the samples
  (``estimators.shared.past_posterior``), and returns to the most probable game so far when it is
  lost: equilibria near uniform weights end at folds on the way to those of five players.

With the state s = (z, x_1), constant in time (Wan and van der Merwe 2000; numbers ours):

    (U1)  S_k = m, m +- alpha sqrt(n) columns of P^(1/2)                     sigma points
    (U2)  z_kr = h(x_r(S_k)) for all times r                                 forward games
    (U3)  z_r + A_r (s - m) with a rest of covariance O_r:                   regression
          z_r = sum w_k z_kr,  A_r = P_zs P^-1,  O_r = P_zz - A_r P A_r'
    (U4)  Kalman update with y_t = z_t + A_t (s - m) + noise of covariance O_t + R
    (U5)  R = sigma^2 I / beta_j, with shares beta_j of the measurement that sum to one
    (U6)  new sigma points only where (U3) does not hold any more
    (U7)  m = argmax pi_t,  P = (P_0^-1 + sum_{r<=t} J_r' J_r)^-1,  where the filter is lost

(U3) and (U4) are the unscented update with the gain P_sz (P_zz + R)^-1 written out (statistical
linear regression: Lefebvre, Bruyninckx and De Schutter 2002). The others are ours:

(U5), after Hanebeck's progressive filtering: a measurement much more precise than the prediction is
used in shares, because one large step would fail in such a nonlinear game. In a linear problem the
shares add up to the plain update.

(U6): a game predicts all measurements, so one set of sigma points serves several of them, and
several shares. The game at the new mean is played after every update, and replaces the prediction
there. The slopes A_r serve on while that game agrees with them to within the noise, and either no
variance of P has fallen far or the rest O_r is small beside the noise.

(U7): pi_t is the posterior given the samples up to t, P_0 the prior's covariance, and J_r the
derivative of sample r over its noise. If the most probable game so far, found by the joint problem,
is clearly more probable than the filter's mean, or if the filter is lost, the belief is replaced by
Laplace's approximation there, and (U1) to (U6) take in later samples. No belief depends on samples
after it.

If a sigma point has no equilibrium that can be followed from the mean's, all of them are moved
closer to the mean (a smaller alpha), an equally valid unscented transform. If an update moves the
mean to a game without an equilibrium, a smaller share is used; if that does not help, the filter is
lost. The estimate says so if noise does not explain what the last game leaves.

Paper: LUCIDGames, Le Cleac'h et al. 2021; unscented transform of Wan and van der Merwe 2000.
Assumes: the prior, a Gaussian belief in its coordinates, and a known noise level.
Cost: 0.1 s for two players, 0.3 to 1 s for five and on roads.
Trust: online, and at high noise, where its prior keeps it from extreme weights. Its regions hold
    the truth as often as they say only where weights come from its prior.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from scipy.linalg import eigh

from olne_bench.checks import check_number
from olne_bench.estimators.protocol import Problem
from olne_bench.estimators.shared.belief import Gaussian, LateError, LostError, symmetric_root
from olne_bench.estimators.shared.past_posterior import Outset, PastPeaks, PastPosterior
from olne_bench.estimators.shared.sample_filter import FilterRun, SampleFilter

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
class Ukf(SampleFilter):
    """Filters weights, unknowns and the initial state, one measurement at a time.

    Raises ValueError on a parameter out of range.

    Attributes:
        spread: standard deviation of the coordinates of weights at first; that of the problem's
            prior is one.
        alpha: distance of the sigma points from the mean, in units of sqrt(n) standard deviations.
        peek: whether the prior is around the weights of a game that is fitted to all observations.
            The weights after early measurements are then not online, and data count twice.
    """

    name: ClassVar[str] = "ukf"
    spread: float = 1.0
    alpha: float = 0.5
    peek: bool = False

    def __post_init__(self) -> None:
        check_number("spread", self.spread)
        check_number("alpha", self.alpha)

    def run(self, problem: Problem, deadline: float, rng: np.random.Generator) -> "_Run":
        """As of ``SampleFilter``; nothing is random."""
        return _Run(self, problem, deadline)


class _Run(FilterRun):
    def __init__(self, estimator: Ukf, problem: Problem, deadline: float) -> None:
        super().__init__(problem, estimator.spread, deadline, peek=estimator.peek)
        self._alpha = estimator.alpha

    def filtered(self, begin: Outset, samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        for belief in _beliefs(begin, samples, self.sigma, self._alpha):
            self.online.append(begin.games.mean_weights(belief))
        size = begin.games.chart.size
        return belief.mean, belief.covariance[:size, :size]

    def certainty(self) -> tuple[np.ndarray, dict[str, Any]]:
        assert self.belief is not None, "there is at least one observation"
        return self.games.weight_belief(self.belief).covariance, {}


@dataclass(frozen=True)
class Regression:
    """(U3): expected measurements at all times, linear around a belief."""

    belief: Gaussian  # the belief (m, P)
    centre: np.ndarray  # (T, d) expected measurements at m
    mean: np.ndarray  # (T, d) their mean z under the belief
    slopes: np.ndarray  # (T, d, n) A
    #: (T, d, n) columns whose products with themselves are the covariance of the rest.
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
    """Filter a constant state (n,) through samples (T, d), NaN where missing, with noise of sigma.

    Points (B, n) have expected measurements (B, T, d), NaN where a point has none; ``alpha`` is as
    in ``Ukf``. Returns the belief after each measurement. Raises LostError if there is no expected
    measurement at the mean.
    """
    run = _Filter(prior, expected, sigma, alpha)
    beliefs = []
    for t, sample in enumerate(samples):
        if np.isfinite(sample).any():
            run.take_in(t, sample)
        beliefs.append(run.belief)
    return beliefs


def _beliefs(begin: Outset, samples: np.ndarray, sigma: float, alpha: float) -> Iterable[Gaussian]:
    """The beliefs after each measurement from the first one on."""
    if begin.peaks is None:
        return filter_samples(begin.prior, begin.games.expected, samples, sigma, alpha)
    run = _PastFilter(begin, begin.peaks, samples, sigma, alpha)
    return (run.take_in(t) for t in range(begin.first, len(samples)))


class _PastFilter:
    """(U7): a filter that begins, and begins again, at the most probable game so far."""

    def __init__(
        self, begin: Outset, peaks: PastPeaks, samples: np.ndarray, sigma: float, alpha: float
    ) -> None:
        self._posterior = PastPosterior(begin.prior, begin.games, samples, sigma)
        self._peaks, self._expected, self._samples = peaks, begin.games.expected, samples
        self._sigma, self._alpha = sigma, alpha
        self._prior = begin.prior
        self._belief: Gaussian | None = None
        self._filter: _Filter | None = None

    def take_in(self, t: int) -> Gaussian:
        """The belief after the measurement at time t.

        Raises LostError if the filter is lost and no game explains the measurements so far;
        LateError after the deadline.
        """
        if self._belief is not None and not np.isfinite(self._samples[t]).any():
            return self._belief
        objective, why = self._updated(t)
        found = self._peaks.better(self._posterior, t, objective)
        if found is not None:
            self._belief, self._filter = self._posterior.climbed(found, t).laplace(), None
        elif why:
            raise LostError(why)
        return self._belief or self._prior

    def _updated(self, t: int) -> tuple[float, str]:
        """-log of the posterior so far at the filter's new mean; infinite if it is lost, and why.

        Raises LateError after the deadline.
        """
        if self._belief is None:
            return np.inf, ""
        try:
            if self._filter is None:
                self._filter = _Filter(self._belief, self._expected, self._sigma, self._alpha)
            self._filter.take_in(t, self._samples[t])
        except LateError:
            raise
        except LostError as error:
            return np.inf, str(error)
        self._belief = self._filter.belief
        return self._posterior.objective(self._belief.mean, self._filter.centre, t), ""


class _Filter:
    """A belief, the expected measurements (T, d) at its mean, and the last set of sigma points."""

    def __init__(self, prior: Gaussian, expected: Expected, sigma: float, alpha: float) -> None:
        self.belief, self._expected, self._sigma = prior, expected, sigma
        self._alphas = [alpha * _SHRINK**k for k in range(_MOST_SHRINKS)]
        self._regression = self._regressed()
        self.centre = self._regression.centre

    def take_in(self, t: int, sample: np.ndarray) -> None:
        """(U1) to (U6) for one measurement; LostError without game, or if shares get too small."""
        seen, left = np.isfinite(sample), 1.0
        for _ in range(_MOST_SHARES):
            if not self._regression.serves(self.belief, self.centre, t, seen, self._sigma):
                self._regression = self._regressed()
                self.centre = self._regression.centre
            share = min(left, _largest_share(self._regression, self.belief, t, seen, self._sigma))
            share = self._use(share, t, sample, seen)
            if share >= left:
                return
            left -= share
        raise LostError("a measurement is too precise for the filter to take in")

    def _use(self, share: float, t: int, sample: np.ndarray, seen: np.ndarray) -> float:
        """(U4) with a share of a measurement, or what of it leads to a game; LostError if none."""
        regression = self._regression
        bend = regression.mean[t, seen] - regression.centre[t, seen]
        slopes, rest = regression.slopes[t, seen], regression.rest(t, seen)
        for _ in range(_MOST_SHRINKS):
            noise = rest + self._sigma**2 / share * np.eye(len(slopes))
            new = _updated(self.belief, sample[seen] - self.centre[t, seen] - bend, slopes, noise)
            (centre,) = self._expected(new.mean[None])
            if np.isfinite(centre).all():
                self.belief, self.centre = new, centre
                return share
            share *= _SHRINK
        raise LostError("no equilibrium where a measurement takes the filter's mean")

    def _regressed(self) -> Regression:
        """(U1) to (U3) with the widest set of sigma points that have games; LostError if none."""
        belief = self.belief
        for alpha in self._alphas:
            rows = self._expected(_sigma_points(belief, alpha))
            if not np.isfinite(rows[0]).all():
                raise LostError("no equilibrium at the filter's mean")
            if np.isfinite(rows).all():
                return _regression(belief, alpha, rows)
        raise LostError("no equilibria around the filter's mean")


def _regression(belief: Gaussian, alpha: float, rows: np.ndarray) -> Regression:
    """(U3) of expected measurements (2n+1, T, d).

    The weight of the mean's row is zero in the sums of squares, so that no covariance is
    indefinite, however small alpha is (beta = alpha^2 + alpha^-2 - 2, kappa = 0).
    """
    count = len(belief.mean)
    spread = _spread(count, alpha)
    weights = np.full(len(rows), 0.5 / (count + spread))
    weights[0] = spread / (count + spread)
    mean = np.tensordot(weights, rows, axes=1)
    ahead, behind = np.split(rows[1:], 2)
    size = np.sqrt(2 * weights[1])
    odd, even = size * (ahead - behind) / 2, size * ((ahead + behind) / 2 - mean)
    # The columns of the root are the changes to which the rows belong.
    inverse = np.linalg.pinv(symmetric_root(belief.covariance), hermitian=True)
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
    """(U4): the belief after a linear measurement; Joseph's form keeps the covariance definite.

    Raises LostError if the noise is lost to rounding beside the belief.
    """
    crossed = belief.covariance @ slopes.T
    try:
        gain = np.linalg.solve(slopes @ crossed + noise, crossed.T).T
    except np.linalg.LinAlgError:
        raise LostError("the belief is too wide for the noise: rounding hides it") from None
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


def _sigma_points(belief: Gaussian, alpha: float) -> np.ndarray:
    """(U1): the mean, then n points ahead of it and n behind, (2n+1, n)."""
    count = len(belief.mean)
    root = symmetric_root((_spread(count, alpha) + count) * belief.covariance)
    return np.concatenate([belief.mean[None], belief.mean + root, belief.mean - root])


def _spread(count: int, alpha: float) -> float:
    """Lambda of the scaled unscented transform in so many dimensions."""
    return alpha**2 * count - count
