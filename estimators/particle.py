"""A particle filter over weights (Peters 2020), as sequential Monte Carlo on static parameters.

In the paper ("Accommodating intention uncertainty in general-sum games for human-robot
interaction"), weighted hypotheses of a player's weights, each with its own game, are reweighed by
how well their games predict measurements that arrive one by one. Here:

- one open-loop equilibrium is observed from an unknown initial state, so a particle is a point
  s = (z, x_1) of coordinates in which the prior is standard normal, and an initial state; the paper
  re-plans a game at every step from a state that it knows.
- s is constant, so particles only lose diversity by resampling, and moving them by Markov chains
  took tens of thousands of games. New particles are drawn instead, where the measurements so far
  put them, and all are weighed as draws from the mixture of all proposals (adaptive multiple
  importance sampling: Cornuet et al. 2012). A particle's game predicts all measurements.

With errors e_t(s) = (y_t - h(x_t(s))) / sigma of the samples that were seen, and particles s_k that
were drawn M at a time from proposals q_1 to q_J:

    (P1)  log pi_t(s) = log N(s; prior) - sum_{r<=t} |e_r|^2 / 2
    (P2)  W_k = pi_t(s_k) / sum_j q_j(s_k) / J                          weights
    (P3)  M_eff = (sum W_k)^2 / sum W_k^2                               effective sample size
    (P4)  while M_eff is too small, draw from a further proposal:
    (P5)  first   m = argmax pi_t,  C = (P^-1 + sum_{r<=t} J_r' J_r)^-1  Laplace's approximation,
          then    the moments of the particles, tempered so that enough of them count, mixed with
                  Laplace's approximation the more, the fewer they are for their dimension

J_r = de_r/ds is exact, and m is found by damped Gauss-Newton steps from the most probable of the
last one, a particle, and the most probable game so far, which the joint problem finds
(``estimators.shared.past_posterior``). The first particles are drawn after the first quarter of the
samples. No particle depends on later samples.

Where the prior of weights is a mixture, its matched single distribution is meant by N(s; prior);
what is left (``NormalChart.tilt``) weighs the particles after each measurement, to the largest
power up to one that leaves a quarter of M effective. Where W themselves leave fewer, they count
with such a power: particles are wider than the posterior then, and the estimate says so.

Proposals have tails of Student's t; those of the last draws are kept, older ones forgotten. A point
whose game has no equilibrium that can be followed from the mean's has a density of zero. The
effective sample size after each measurement is reported, and the covariance of the weights is wider
by what so few samples leave open (``widening``). Between several trajectories, the belief about the
weights is passed on as a Gaussian.

Paper: Peters 2020; proposals and weights after Cornuet et al. 2012.
Assumes: the prior, and a known noise level.
Cost: 0.2 s for two players, 1 to 4 s for five and on roads: by far the most games.
Trust: if the posterior is far from Gaussian; the least effective sample size shows how well it
    worked.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import brentq
from scipy.special import gammaln, logsumexp

from olne_bench.checks import check_count, check_number
from olne_bench.estimators.protocol import Problem
from olne_bench.estimators.shared.belief import FollowedGames, Gaussian, LostError
from olne_bench.estimators.shared.past_posterior import (
    Games,
    Linearised,
    Outset,
    PastPeaks,
    PastPosterior,
    Tangent,
)
from olne_bench.estimators.shared.perturbed_fits import effective_sample_size, tempered
from olne_bench.estimators.shared.sample_filter import FilterRun, SampleFilter

#: Effective sample sizes, in units of ``count``, that end the draws for a measurement, and for the
#: last one.
_ENOUGH, _ENOUGH_AT_LAST = 0.25, 0.5

#: Particles of one draw, in units of ``count``, and number of draws that are kept.
_DRAWN, _KEPT = 0.5, 12

#: Degrees of freedom of proposals. Heavier tails cost particles in some thirty dimensions.
_DEGREES = 25.0

#: Effective particles, in units of their dimension, at which a proposal is halfway from Laplace's
#: approximation to their own moments.
_TRUSTED = 10

#: Particles whose weights have to count with a smaller power explain nothing.
_LEAST_POWER = 0.05

#: Stands for the log of no density.
_FARTHEST = 1e3

#: Least variance of a proposal, relative to its largest one.
_LEAST_VARIANCE = 1e-14

#: A particle whose log density is higher by this is a better start for these steps than the last
#: peak.
_BETTER = 10.0


@dataclass(frozen=True)
class Cloud:
    """Weighted particles after a measurement."""

    points: np.ndarray  # (M, n)
    shares: np.ndarray  # (M,) their weights W, which sum to one
    effective: float  # effective sample size, without what a mixture leaves
    power: float = 1.0  # with which the rest counts: below one if few are effective
    tilt_power: float = 1.0  # with which that counts


@dataclass(frozen=True)
class Particle(SampleFilter):
    """Particles over weights, unknowns and initial states.

    Raises ValueError on a parameter out of range.

    Attributes:
        count: the effective sample size is at least a quarter of it after each measurement, half of
            it after the last, unless ``most_draws`` ends the draws; half of it are drawn at a time.
        spread: as of ``Ukf``.
        most_draws: largest number of draws for a measurement; twice as many for the last one.
        peek: as of ``Ukf``.
    """

    name: ClassVar[str] = "particle"
    count: int = 200
    spread: float = 1.0
    most_draws: int = 8
    peek: bool = False

    def __post_init__(self) -> None:
        check_count("count", self.count, least=2)
        check_number("spread", self.spread)
        check_count("most_draws", self.most_draws)

    def run(self, problem: Problem, deadline: float, rng: np.random.Generator) -> "_Run":
        """As of ``SampleFilter``."""
        return _Run(self, problem, deadline, rng)


class _Run(FilterRun):
    def __init__(
        self, estimator: Particle, problem: Problem, deadline: float, rng: np.random.Generator
    ) -> None:
        super().__init__(problem, estimator.spread, deadline, peek=estimator.peek)
        self._estimator, self._rng = estimator, rng
        self._effective: list[float] = []

    def filtered(self, begin: Outset, samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        self._effective += [np.nan] * begin.first
        clouds = filter_particles(
            begin.prior,
            begin.games,
            samples,
            self.sigma,
            count=self._estimator.count,
            most_draws=self._estimator.most_draws,
            rng=self._rng,
            first=begin.first,
            peaks=begin.peaks,
        )
        for cloud in clouds:
            self.online.append(_mean_weights(begin.games, cloud))
            self._effective.append(cloud.effective)
        self.remarks.append(_wider(cloud))
        self._cloud, size = cloud, begin.games.chart.size
        return cloud.shares @ cloud.points, _covariance(cloud.points[:, :size], cloud.shares)

    def certainty(self) -> tuple[np.ndarray, dict[str, Any]]:
        cloud, free = self._cloud, self.games.chart.free
        weights = self.games.weights(cloud.points).reshape(len(cloud.points), -1)
        effective = float(1 / np.sum(cloud.shares**2))
        wider = widening(effective, free)
        if wider is None and not self.message:
            self.message = (
                f"{effective:.1f} effective particles do not tell the covariance of "
                f"{free} free weights"
            )
        return (wider or 1.0) * _covariance(weights, cloud.shares), {
            "effective_sample_size": np.array(self._effective),
            "least_effective_sample_size": float(np.nanmin(self._effective)),
        }


def filter_particles(
    prior: Gaussian,
    games: Games,
    samples: np.ndarray,
    sigma: float,
    *,
    count: int,
    most_draws: int,
    rng: np.random.Generator,
    first: int = 0,
    peaks: PastPeaks | None = None,
) -> Iterator[Cloud]:
    """Filter a constant state (n,) through samples (T, d), NaN where missing, with noise of sigma.

    Yields all particles so far after each measurement from the time ``first`` on. They are drawn at
    ``peaks``, points of the most probable games so far, or from the prior if None; ``count`` and
    ``most_draws`` are those of ``Particle``. Raises LostError if no particle has a game, or none
    explains the measurements.
    """
    pool = _Pool(prior, games, samples, sigma, count, rng, peaks)
    for t in range(first, len(samples)):
        last = t == len(samples) - 1
        enough = _ENOUGH_AT_LAST if last else _ENOUGH
        cloud = pool.take_in(t, enough * count, 2 * most_draws if last else most_draws)
        yield cloud
    if cloud.power < _LEAST_POWER:
        raise LostError(f"effective sample size {cloud.effective:.1f} of {count}")


def _wider(cloud: Cloud) -> str:
    """What makes particles wider than the posterior; empty if they are not."""
    what, power = "their weights count", cloud.power
    if power == 1:
        what, power = "the prior's mixture counts", cloud.tilt_power
    said = f"particles are wider than the posterior: {what} with a power of {power:.2g}"
    return said if power < 1 else ""


def _tilt_power(log_shares: np.ndarray, tilts: np.ndarray, enough: float) -> float | None:
    """The largest factor up to one with which tilts leave so many effective; None if none does."""

    def excess(factor: float) -> float:
        return effective_sample_size(log_shares + factor * tilts) - enough

    if excess(1.0) >= 0:
        return 1.0
    return None if excess(0.0) < 0 else float(brentq(excess, 0.0, 1.0, xtol=1e-6))


class _Pool:
    """The particles of the last draws, with the squared errors of their games."""

    def __init__(
        self,
        prior: Gaussian,
        games: Games,
        samples: np.ndarray,
        sigma: float,
        count: int,
        rng: np.random.Generator,
        peaks: PastPeaks | None,
    ) -> None:
        self._games, self._samples, self._sigma, self._rng = games, samples, sigma, rng
        self._posterior = PastPosterior(prior, games, samples, sigma)
        self._size = max(2, round(_DRAWN * count))
        self._prior = self._laplace = prior
        self._proposals: list[_Proposal] = []
        self._points = np.empty((0, len(prior.mean)))
        self._squared = np.empty((0, len(samples)))
        self._log_prior, self._tilts, self._densities = np.empty(0), np.empty(0), np.empty((0, 0))
        self._count = count
        self._log_norm = float(-_Proposal(prior, np.inf).log(prior.mean[None])[0])
        self._peak: Tangent | None = None
        self._peaks = peaks
        if peaks is not None:
            return
        self._peak = self._posterior.tangent(prior.mean)
        self._draw(prior)
        if not np.isfinite(self._squared).any():
            raise LostError("no particle has an equilibrium before the first measurement")

    def take_in(self, t: int, enough: float, most_draws: int) -> Cloud:
        """(P1) to (P5) for the measurement at time t; LostError if no particle has a game."""
        log_shares = self._log_shares(t)
        for k in range(most_draws):
            if effective_sample_size(log_shares) >= enough:
                break
            if k == 0:
                self._laplace = self._laplace_at(t)
            self._draw(self._laplace if k == 0 else self._adapted(log_shares, k))
            log_shares = self._log_shares(t)
        if not np.isfinite(log_shares).any():
            raise LostError("no particle has an equilibrium")
        effective = effective_sample_size(log_shares)
        tilts = np.where(np.isfinite(self._tilts), self._tilts, -_FARTHEST)
        tilt_power, power = _tilt_power(log_shares, tilts, _ENOUGH * self._count), 1.0
        if tilt_power is None:
            tilt_power = 0.0
            log_shares, power = tempered(log_shares, _ENOUGH * self._count)
        shares = _normalised(log_shares + tilt_power * tilts)
        return Cloud(self._points, shares, effective, power, tilt_power)

    def _draw(self, around: Gaussian) -> None:
        """Draw particles; forget those of the oldest draw if there are too many."""
        proposal = _Proposal(around, _DEGREES)
        points = proposal.draw(self._size, self._rng)
        squared = self._squared_errors(around.mean, points)
        gone = int(len(self._proposals) == _KEPT)
        old = slice(gone * self._size, None)
        self._proposals = [*self._proposals[gone:], proposal]
        before = self._densities[gone:, old]
        own = np.array([one.log(points) for one in self._proposals])
        last = proposal.log(self._points[old])
        self._densities = np.block([[before, own[:-1]], [last, own[-1]]]) if len(last) else own
        log_prior = _Proposal(self._prior, np.inf).log(points)
        self._points = np.vstack([self._points[old], points])
        self._squared = np.vstack([self._squared[old], squared])
        self._log_prior = np.concatenate([self._log_prior[old], log_prior])
        self._tilts = np.concatenate([self._tilts[old], self._games.tilt(points)])

    def _log_shares(self, t: int) -> np.ndarray:
        """Log W (P2), without the factor J."""
        if not len(self._points):
            return np.array([-np.inf])
        log_target = self._log_prior - self._squared[:, : t + 1].sum(axis=1) / 2
        return np.asarray(log_target - logsumexp(self._densities, axis=0))

    def _adapted(self, log_shares: np.ndarray, k: int) -> Gaussian:
        """The second kind of proposal (P5)."""
        if not np.isfinite(log_shares).any():
            return self._laplace
        dimension = len(self._prior.mean)
        shares = _normalised(tempered(log_shares, max(self._size / 2, dimension))[0])
        mean, covariance = shares @ self._points, _covariance(self._points, shares)
        effective = 1 / np.sum(shares**2)
        own = effective / (effective + _TRUSTED * dimension / k**2)
        return Gaussian(
            own * mean + (1 - own) * self._laplace.mean,
            own * covariance + (1 - own) * self._laplace.covariance,
        )

    def _laplace_at(self, t: int) -> Gaussian:
        """The first kind of proposal (P5); the last one where there is no game to start from."""
        here = self._start_at(t)
        if here is None:
            return self._laplace
        here = self._posterior.climbed(here, t)
        self._peak = here.tangent
        return here.laplace()

    def _start_at(self, t: int) -> Linearised | None:
        """Where to look for the peak: at the last one, or at a point that is far better."""
        here = self._posterior.linearised(self._peak, t)
        if len(self._points):
            objectives = self._squared[:, : t + 1].sum(axis=1) / 2 - self._log_prior
            best = int(np.argmin(objectives))
            gain = self._log_norm + (here.objective if here else np.inf) - objectives[best]
            if gain > _BETTER:
                tangent = self._posterior.tangent(self._points[best])
                here = self._posterior.linearised(tangent, t) or here
        if self._peaks is None:
            return here
        return self._peaks.better(self._posterior, t, here.objective if here else np.inf) or here

    def _squared_errors(self, mean: np.ndarray, points: np.ndarray) -> np.ndarray:
        """|e_t(s)|^2 (M, T) of points (M, n); infinite if there is no equilibrium."""
        expected = self._games.expected(np.vstack([mean, points]))[1:]
        playable = np.isfinite(expected).all(axis=(1, 2))
        squared = np.nansum(((expected - self._samples) / self._sigma) ** 2, axis=2)
        squared[~playable] = np.inf
        return np.asarray(squared)


class _Proposal:
    """Student's t around a Gaussian; with infinitely many degrees of freedom, the Gaussian."""

    def __init__(self, around: Gaussian, degrees: float) -> None:
        self._mean, self._degrees = around.mean, degrees
        self._root = _root_of(around.covariance)
        size = len(around.mean)
        self._inverse = solve_triangular(self._root, np.eye(size), lower=True)
        self._log_peak = -np.log(np.diag(self._root)).sum() - size / 2 * np.log(2 * np.pi)
        if np.isfinite(degrees):
            self._log_peak += gammaln((degrees + size) / 2) - gammaln(degrees / 2)
            self._log_peak -= size / 2 * np.log(degrees / 2)

    def draw(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """(count, n)."""
        noise = rng.standard_normal((count, len(self._mean)))
        if np.isfinite(self._degrees):
            noise *= np.sqrt(self._degrees / rng.chisquare(self._degrees, (count, 1)))
        return np.asarray(self._mean + noise @ self._root.T)

    def log(self, points: np.ndarray) -> np.ndarray:
        """Log density (M,) of points (M, n)."""
        squares = (((points - self._mean) @ self._inverse.T) ** 2).sum(axis=1)
        if not np.isfinite(self._degrees):
            return np.asarray(self._log_peak - squares / 2)
        power = (self._degrees + len(self._mean)) / 2
        return np.asarray(self._log_peak - power * np.log1p(squares / self._degrees))


def _root_of(covariance: np.ndarray) -> np.ndarray:
    """Lower root of a covariance; variances that rounding made negative become tiny ones."""
    try:
        return np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
        values = np.maximum(values, _LEAST_VARIANCE * max(float(values[-1]), np.finfo(float).tiny))
        upper = np.asarray(np.linalg.qr(np.sqrt(values)[:, None] * vectors.T, mode="r"))
        return np.transpose(upper * np.where(np.diag(upper) < 0, -1, 1)[:, None])


def widening(effective: float, size: int) -> float | None:
    """Factor of a sample covariance for regions around a sample mean; None for too few samples.

    The inverse of the covariance of M samples in d dimensions is too large by (M-1) / (M-d-2) in
    the mean (Hartlap, Simon and Schneider 2007), and their mean errs by 1/M of the covariance.
    """
    left = effective - size - 2
    return (effective - 1) / left * (1 + 1 / effective) if left > 0 else None


def _normalised(log_shares: np.ndarray) -> np.ndarray:
    return np.asarray(np.exp(log_shares - logsumexp(log_shares)))


def _covariance(points: np.ndarray, shares: np.ndarray) -> np.ndarray:
    return np.atleast_2d(np.cov(points, rowvar=False, aweights=shares, ddof=0))


def _mean_weights(forward: FollowedGames, cloud: Cloud) -> np.ndarray:
    """(N, K) mean of the particles' weights, which lies on the simplex as they do."""
    return np.tensordot(cloud.shares, forward.weights(cloud.points), axes=1)
