"""A particle filter over weights (Peters 2020), as sequential Monte Carlo on static parameters.

From the paper ("Accommodating intention uncertainty in general-sum games for human-robot
interaction"): a player's weights are represented by a set of weighted hypotheses. Each hypothesis
has its own game. Measurements arrive one by one and reweigh the hypotheses by how well their games
predicted them.

Where this departs from the paper, and why:

- The paper re-plans a game at every step from a state that it knows. Here one open-loop
  equilibrium is observed from an unknown initial state, so that a particle is a point
  s = (phi, x_1) of log-ratios of weights and an initial state. Its prior is that of ``ukf``
  (``estimators.belief``): around a first game that all observations were used to find.
- s is constant, so the copies of a particle after resampling would never separate. They are moved
  by Metropolis-Hastings steps, which do not change the current posterior (Chopin 2002), rather than
  by noise, which would widen it.
- A measurement can be so much more precise than the prediction that only one particle would be
  left. It is used in shares, each as large as the effective sample size allows (Del Moral, Doucet
  and Jasra 2012).

With weights W_k of M particles s_k, and errors e_t(s) = (y_t - h(x_t(s))) / sigma of the samples
that were seen:

    (P1)  log W_k -= beta |e_t(s_k)|^2 / 2                              a share beta of y_t
    (P2)  M_eff = (sum W_k)^2 / sum W_k^2                               effective sample size
    (P3)  beta: the rest of y_t, or less, so that M_eff = M / 2
    (P4)  if y_t is not used up: resample, systematically, and move:
    (P5)  s' = m + sqrt(1 - b^2) (s - m) + b C^(1/2) xi,   xi ~ N(0, I)
    (P6)  accept with  min(1, pi(s') N(s; m, C) / (pi(s) N(s'; m, C)))
          log pi(s) = log N(s; prior) - sum_{r<t} |e_r|^2 / 2 - (share so far) |e_t|^2 / 2

(P5) is reversible for the Gaussian N(m, C) with the particles' mean and covariance. If the
posterior is Gaussian, every move is accepted, for any dimension and length b (preconditioned
Crank-Nicolson: Cotter et al. 2013; used here as by Kantas, Beskos and Jasra 2014). The length b
adapts to the acceptance rate. The moves end when the particles have moved, summed over moves and in
the metric of C, as far as independent draws would, or after ``most_moves``.

A point whose game has no equilibrium that can be followed from the mean's has a density of zero.
The least effective sample size that each measurement led to, before resampling, is reported.
Between several trajectories, the belief about the weights is passed on as a Gaussian.

Paper: Peters 2020; moves after Chopin 2002 and Cotter et al. 2013.
Assumes: a known noise level, and weights near those of a first game that explains the observations.
Cost: 1.4 s for two players, 10 s for five, 30 s on roads: by far the most games.
Trust: if the posterior is far from Gaussian and there is time; the least effective sample size
    shows how well it worked.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.optimize import brentq
from scipy.special import logsumexp
from scipy.stats import Covariance, multivariate_normal

from olne_bench.checks import check_count, check_number
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
from olne_bench.estimators.white_noise import white_problem, with_white_noise

#: Particles are resampled when the effective sample size falls to this share of all particles.
_RESAMPLE_BELOW = 0.5

#: Acceptance rates below and above which the length b of moves shrinks and grows, and the factor.
_RARE, _FREQUENT, _LENGTH_FACTOR = 0.2, 0.5, 1.5

#: Shortest length b, of 1 at most.
_SHORTEST = 1e-3

#: Largest number of shares of a measurement.
_MOST_SHARES = 100

#: Share of the diagonal in the covariance C of moves, which keeps it regular for few particles.
_RIDGE = 0.01

#: Moves that leave fewer distinct particles than this share of all have failed.
_LEAST_DISTINCT = 0.1

Expected = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Cloud:
    """Weighted particles after a measurement.

    Attributes:
        points: (M, n).
        shares: (M,) their weights W, which sum to one.
        effective: least effective sample size since the measurement before.
    """

    points: np.ndarray
    shares: np.ndarray
    effective: float


@dataclass(frozen=True)
class Particle:
    """Particles over log-ratios of weights and initial states, moved by Metropolis-Hastings.

    Attributes:
        count: number M of particles.
        spread: prior standard deviation of the log-ratios, in units of that of weights that are
            uniform on the simplex.
        most_moves: largest number of moves after a resampling.

    Raises:
        ValueError: on a parameter out of range.
    """

    name: ClassVar[str] = "particle"
    several: ClassVar[bool] = True
    count: int = 200
    spread: float = 0.5
    most_moves: int = 6

    def __post_init__(self) -> None:
        check_count("count", self.count, least=2)
        check_number("spread", self.spread)
        check_count("most_moves", self.most_moves)

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
        run = _Run(self, problem, deadline, rng)
        try:
            for one in observations:
                run.take_in(one)
        except LostError as error:
            last = run.online[-1] if run.online else uniform_weights(problem)
            return Estimate(weights=last, converged=False, message=str(error))
        return run.estimate()

    def supports(self, problem: Problem) -> str | None:
        """Why this problem cannot be filtered, or None."""
        return hidden_positions(problem)

    def warm_up(self, problem: Problem) -> None:
        """Build the solvers."""
        problem = white_problem(problem)
        warm_up_games(problem)


class _Run:
    """The state of one estimate, which filters trajectories in turn.

    Attributes:
        online: mean weights (N, K) after each measurement.
    """

    def __init__(
        self,
        estimator: Particle,
        problem: Problem,
        deadline: float,
        rng: np.random.Generator,
    ) -> None:
        self._estimator, self._problem = estimator, problem
        self._deadline, self._rng = deadline, rng
        self._sigma = max(problem.sigma, LEAST_SIGMA)
        self.online: list[np.ndarray] = []
        self._effective: list[float] = []
        self._belief: Gaussian | None = None
        self._first_states: np.ndarray | None = None
        self._objective = 0.0

    def take_in(self, observation: Observation) -> None:
        """Filter a trajectory, starting from the current belief about the weights.

        Raises:
            LostError: as in ``filter_particles``.
        """
        problem, estimator = self._problem, self._estimator
        start = first_game(problem, observation)
        prior = prior_belief(
            problem, observation, start, self._belief, estimator.spread, self._sigma
        )
        self._forward = forward = FollowedGames(problem, start, self._deadline)
        clouds = filter_particles(
            prior,
            forward.expected,
            scaled_samples(problem, observation.y),
            self._sigma,
            count=estimator.count,
            most_moves=estimator.most_moves,
            rng=self._rng,
        )
        for cloud in clouds:
            self.online.append(_mean_weights(forward, cloud))
            self._effective.append(cloud.effective)
        self._cloud = cloud
        mean, size = cloud.shares @ cloud.points, forward.num_log_ratios
        states = forward.play(mean).root.states
        self._objective += squared_error_of(problem, states, observation.y)
        self._first_states = states if self._first_states is None else self._first_states
        self._belief = Gaussian(mean[:size], _covariance(cloud.points[:, :size], cloud.shares))

    def estimate(self) -> Estimate:
        """The mean of the last particles."""
        cloud = self._cloud
        weights = self._forward.weights(cloud.points).reshape(len(cloud.points), -1)
        return Estimate(
            weights=self.online[-1],
            states=self._first_states,
            covariance=_covariance(weights, cloud.shares),
            extras={
                "objective": self._objective,
                "online_weights": np.array(self.online),
                "effective_sample_size": np.array(self._effective),
                "least_effective_sample_size": min(self._effective),
            },
        )


def filter_particles(
    prior: Gaussian,
    expected: Expected,
    samples: np.ndarray,
    sigma: float,
    *,
    count: int,
    most_moves: int,
    rng: np.random.Generator,
) -> Iterator[Cloud]:
    """Filter a constant state through measurements that arrive one by one.

    Args:
        prior: belief about the state (n,) before the measurements.
        expected: points (B, n), the mean first -> expected measurements (B, T, d), NaN for a point
            that has none.
        samples: (T, d) measurements, NaN where missing.
        sigma: standard deviation of their noise.
        count: number of particles.
        most_moves: largest number of moves after a resampling.
        rng: the source of randomness.

    Yields:
        The particles after each of the T measurements.

    Raises:
        LostError: if no particle explains a measurement, or if too few distinct ones are left.
    """
    particles = _Particles(prior, expected, samples, sigma, count, most_moves, rng)
    for t in range(len(samples)):
        yield particles.take_in(t)


class _Particles:
    """Particles, with the squared errors of their games at every measurement."""

    def __init__(
        self,
        prior: Gaussian,
        expected: Expected,
        samples: np.ndarray,
        sigma: float,
        count: int,
        most_moves: int,
        rng: np.random.Generator,
    ) -> None:
        prior_root = np.linalg.cholesky(prior.covariance)
        known = multivariate_normal(prior.mean, Covariance.from_cholesky(prior_root))
        self._log_prior, self._expected = known.logpdf, expected
        self._samples, self._sigma = samples, sigma
        self._most_moves, self._rng, self._length = most_moves, rng, 1.0
        self._points = prior.mean + rng.standard_normal((count, len(prior_root))) @ prior_root.T
        self._squared = self._squared_errors(prior.mean, self._points)
        self._log_shares = np.where(np.isfinite(self._squared[:, 0]), 0.0, -np.inf)
        self._squared[~np.isfinite(self._log_shares)] = 0.0
        if not np.isfinite(self._log_shares).any():
            raise LostError("no particle has an equilibrium before the first measurement")

    def take_in(self, t: int) -> Cloud:
        """(P1) to (P4) for the measurement at time t.

        Raises:
            LostError: if it has to be split into too many shares.
        """
        enough = _RESAMPLE_BELOW * len(self._points)
        left, least = 1.0, np.inf
        for _ in range(_MOST_SHARES):
            half = self._squared[:, t] / 2
            beta = _largest_share(self._log_shares, half, left, enough)
            self._log_shares = self._log_shares - beta * half
            left -= beta
            effective = effective_sample_size(self._log_shares)
            least = min(least, effective)
            if left <= 0 and effective >= enough:
                return Cloud(self._points, _normalised(self._log_shares), least)
            self._resample_and_move(t, 1 - left)
        raise LostError("no particle explains a measurement")

    def _resample_and_move(self, t: int, used: float) -> None:
        """(P4) to (P6); the density includes the share ``used`` of the measurement at t."""
        shares = _normalised(self._log_shares)
        mean, covariance = shares @ self._points, _covariance(self._points, shares)
        covariance = (1 - _RIDGE) * covariance + _RIDGE * np.diag(np.diag(covariance))
        root = np.linalg.cholesky(covariance)
        reference = multivariate_normal(mean, Covariance.from_cholesky(root))

        def log_ratio(points: np.ndarray, squared: np.ndarray) -> np.ndarray:
            """Log pi(s) / N(s; m, C)."""
            playable = np.isfinite(squared[:, 0])
            squared = np.where(playable[:, None], squared, 0.0)
            errors = squared[:, :t].sum(axis=1) + used * squared[:, t]
            ratio = self._log_prior(points) - errors / 2 - reference.logpdf(points)
            return np.where(playable, ratio, -np.inf)

        chosen = systematic_resample(shares, self._rng)
        self._points, self._squared = self._points[chosen], self._squared[chosen]
        self._log_shares = np.zeros(len(chosen))
        current, gone = log_ratio(self._points, self._squared), 0.0
        for _ in range(self._most_moves):
            noise = self._rng.standard_normal(self._points.shape) @ root.T
            trial = mean + np.sqrt(1 - self._length**2) * (self._points - mean)
            trial += self._length * noise
            squared = self._squared_errors(mean, trial)
            proposed = log_ratio(trial, squared)
            accepted = np.log(self._rng.random(len(trial))) < proposed - current
            jumps = np.linalg.solve(root, (trial - self._points)[accepted].T)
            gone += float(np.sum(jumps**2)) / (2 * trial.size)
            for mine, theirs in (
                (self._points, trial),
                (self._squared, squared),
                (current, proposed),
            ):
                mine[accepted] = theirs[accepted]
            self._adapt(float(accepted.mean()))
            if gone >= 1:
                return
        distinct = len(np.unique(self._points, axis=0))
        if distinct < _LEAST_DISTINCT * len(chosen):
            raise LostError(f"only {distinct} of {len(chosen)} particles are left, and do not move")

    def _adapt(self, acceptance: float) -> None:
        if acceptance < _RARE:
            self._length = max(_SHORTEST, self._length / _LENGTH_FACTOR)
        elif acceptance > _FREQUENT:
            self._length = min(1.0, self._length * _LENGTH_FACTOR)

    def _squared_errors(self, mean: np.ndarray, points: np.ndarray) -> np.ndarray:
        """|e_t(s)|^2 (M, T) of points (M, n); infinite if there is no equilibrium."""
        expected = self._expected(np.vstack([mean, points]))[1:]
        playable = np.isfinite(expected).all(axis=(1, 2))
        squared = np.nansum(((expected - self._samples) / self._sigma) ** 2, axis=2)
        squared[~playable] = np.inf
        return squared


def systematic_resample(shares: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Indices (M,) of particles, each as often as its share of M, rounded up or down.

    ``filterpy.monte_carlo.systematic_resample`` does the same, but draws from NumPy's global
    generator instead of ``rng``.
    """
    count = len(shares)
    places = (rng.random() + np.arange(count)) / count
    return np.searchsorted(np.cumsum(shares), places).clip(max=count - 1)


def effective_sample_size(log_shares: np.ndarray) -> float:
    """M_eff (P2) of shares that need not sum to one, by their logarithms."""
    return float(np.exp(2 * logsumexp(log_shares) - logsumexp(2 * log_shares)))


def _largest_share(log_shares: np.ndarray, half: np.ndarray, left: float, enough: float) -> float:
    """(P3): the largest share of a measurement, up to ``left``, that leaves enough particles."""

    def excess(beta: float) -> float:
        return effective_sample_size(log_shares - beta * half) - enough

    if excess(left) >= 0:
        return left
    if excess(0.0) <= 0:
        return 0.0
    return float(brentq(excess, 0.0, left, rtol=1e-6, xtol=1e-300))


def _normalised(log_shares: np.ndarray) -> np.ndarray:
    return np.exp(log_shares - logsumexp(log_shares))


def _covariance(points: np.ndarray, shares: np.ndarray) -> np.ndarray:
    return np.atleast_2d(np.cov(points, rowvar=False, aweights=shares, ddof=0))


def _mean_weights(forward: FollowedGames, cloud: Cloud) -> np.ndarray:
    """(N, K) mean of the particles' weights, which lies on the simplex as they do."""
    return np.tensordot(cloud.shares, forward.weights(cloud.points), axes=1)
