"""Samples of the posterior: weights, unknowns and initial state, given all observations.

The prior of a player's weights is the problem's; that of standardised unknowns is normal within
their ranges; that of x_1 is flat, and a wide normal one where the first sample misses a player.
With Gaussian noise, in coordinates z of weights and unknowns in which their prior is standard
normal (``charts``),

    (B1)  log pi(z, x_1) = -|y - h(x(theta(z), x_1))|^2 / (2 sigma^2) - |z|^2 / 2,

with the equilibrium x(theta, x_1) that is followed from one that explains the observations
(``posterior_density``).

1. Every optimum of the joint problem with the prior (``map``) that could be meant is moved to the
   peak of (B1) near it by Gauss-Newton steps.
2. Fits of perturbed observations from all peaks are independent points of a known density, which
   follows the bends of (B1); further fits start where they miss it (``perturbed_fits``).
3. The points are resampled by their importance weights. Where these leave fewer than 400 effective
   points (``enough``), their powers are used that leave so many: the samples are then wider
   than the posterior, and the message says so. Where hardly a fit ends, they are Laplace's
   approximation of the most probable peak.

Equilibria end at folds, where the posterior ends as well.

Paper: sampling after Bardsley et al. 2014 (randomize-then-optimize).
Assumes: truths drawn from the prior, and what ``kkt_constrained`` does.
Cost: 1,300 to 50,000 games and as many derivatives.
Trust: for what else the observations allow: near the simplex's boundary, at folds and between
    optima. A message says where its samples are wider than the posterior.
"""

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from olne_bench.checks import check_count, check_number
from olne_bench.estimators.map import Map, check_alpha, prior_of, probable_optima
from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.estimators.shared.charts import NormalChart
from olne_bench.estimators.shared.forward_model import (
    squared_error_of,
    uniform_weights,
    warm_up_games,
)
from olne_bench.estimators.shared.joint_problem import JointSolution
from olne_bench.estimators.shared.joint_starts import lowest
from olne_bench.estimators.shared.noise_level import telling_noise, with_found_noise
from olne_bench.estimators.shared.perturbed_fits import Fits, Peak, perturbed_fits, resampled
from olne_bench.estimators.shared.pooled import Recorded, SharedDensity, Together, checked, games_of
from olne_bench.estimators.shared.posterior_density import (
    Density,
    GameDensity,
    Places,
    climbed,
    start_prior,
)
from olne_bench.estimators.shared.white_noise import assumed_sigma, white_problem, with_white_noise

#: Fits that have to end for an answer from them.
_FEWEST = 40

#: R-hat above this is told.
LARGEST_R_HAT = 1.1

#: Optima whose log-density is lower by more than this are not meant.
_MEANT = 15.0

#: Peaks nearer to each other than this, in standard deviations, are one.
_SAME = 0.1


@dataclass(frozen=True)
class Posterior:
    """Samples of weights, unknowns and initial state.

    Raises ValueError on a parameter out of range.

    Attributes:
        alpha: parameter of a symmetric Dirichlet distribution in place of the problem's prior.
        first: fits of perturbed observations from all peaks together.
        more: fits from every further place.
        most: number of all fits at most.
        enough: effective sample size at which they end.
        count: number of samples, all of equal weight.
    """

    name: ClassVar[str] = "posterior"
    alpha: float | None = None
    first: int = 300
    more: int = 150
    most: int = 2400
    enough: float = 400.0
    count: int = 1000

    def __post_init__(self) -> None:
        check_alpha(self.alpha)
        check_count("first", self.first, least=40)
        check_count("more", self.more, least=10)
        check_count("most", self.most, least=self.first)
        check_number("enough", self.enough, most=1e6)
        check_count("count", self.count, least=40, most=4000)

    def estimate(
        self, problem: Problem, observation: Observation, *, rng: np.random.Generator, budget: float
    ) -> Estimate:
        problem, (seen,) = with_white_noise(problem, observation)
        deadline = time.monotonic() + budget
        unseen = np.flatnonzero(~np.isfinite(seen.y).any(axis=(0, 2)))
        if unseen.size:
            players = ", ".join(map(str, unseen))
            return _nothing(problem, f"never seen, hence not identified: player {players}")
        asked, problem = problem, with_found_noise(problem, (seen,), deadline)
        prior = prior_of(problem, self.alpha)
        problem = replace(problem, sigma=assumed_sigma(problem), prior=prior)
        density, peaks = self.peaks(problem, seen, deadline)
        if not peaks:
            return _nothing(problem, "no equilibrium found that explains the observations")
        fits = self._fits(density, peaks, rng)
        return telling_noise(self._estimate(density, peaks, fits, rng), asked, problem)

    def _fits(self, density: Density, peaks: Sequence[Peak], rng: np.random.Generator) -> Fits:
        counts = {"first": self.first, "more": self.more, "most": self.most}
        return perturbed_fits(density, peaks, rng, **counts, enough=self.enough)

    def together(
        self, motions: Sequence[Recorded], *, rng: np.random.Generator, budget: float
    ) -> Together:
        """Samples of what several motions of unlike cars say about their drivers' weights.

        The search ends after ``budget`` seconds. Raises ValueError on motions that do not fit each
        other.
        """
        motions, deadline = _with_prior(checked(motions), self.alpha), time.monotonic() + budget
        attempts = Map().attempts_together(motions, deadline)
        best = Map().described_together(motions, lowest(attempts))
        parts = [self.density(one.problem, one.observation, deadline) for one in motions]
        density = SharedDensity(parts, [one.drivers for one in motions])
        optima = _meant(motions[0].problem, [one for one in attempts if one.converged])
        peaks = different_peaks(density, (density.place(games_of(one)) for one in optima))
        if not best.converged or not peaks:
            return best
        fits = self._fits(density, peaks, rng)
        points, shares, power = self._weighed(peaks[0], fits, rng)
        weights = density.chart.weights(points[:, : density.chart.size])
        return replace(
            best,
            weights=np.tensordot(shares, weights, 1),
            covariance=_covariance(weights, shares),
            samples=weights[resampled(shares, self.count, rng)],
            message=self._remark(fits, power, late=density.late),
        )

    def peaks(
        self, problem: Problem, observation: Observation, deadline: float
    ) -> tuple[GameDensity, list[Peak]]:
        """The density (B1) and its peaks, the most probable first.

        The noise is white and sigma positive. The search ends by the deadline, in seconds of
        ``time.monotonic``.
        """
        optima = probable_optima(problem, observation.y, problem.prior, deadline)
        density = self.density(problem, observation, deadline)
        games = (games_of(one)[0] for one in _meant(problem, optima))
        return density, different_peaks(density, map(density.place, games))

    def density(self, problem: Problem, observation: Observation, deadline: float) -> GameDensity:
        """The density (B1), as of ``peaks``; (B1) with a prior of x_1 overrides it."""
        start = start_prior(problem, observation)
        return GameDensity(problem, observation, NormalChart.of(problem), deadline, start)

    def _estimate(
        self, density: GameDensity, peaks: Sequence[Peak], fits: Fits, rng: np.random.Generator
    ) -> Estimate:
        """Mean, covariance and samples."""
        problem, known = density.problem, density.problem.game.parameters
        points, shares, power = self._weighed(peaks[0], fits, rng)
        theta, starts = density.split(points)
        weights, parameters = np.split(theta, [problem.game.num_weights], axis=2)
        unknown = known.values(parameters) if known.count else None
        mean = np.tensordot(shares, theta, 1)
        states = density.states(mean, np.tensordot(shares, starts, 1), peaks[0].place)
        chosen = resampled(shares, self.count, rng)
        return Estimate(
            weights=mean[:, : problem.game.num_weights],
            states=states,
            covariance=_covariance(weights, shares),
            parameters=None if unknown is None else np.tensordot(shares, unknown, 1),
            parameter_deviations=None if unknown is None else unknown[chosen].std(axis=0),
            samples=weights[chosen],
            parameter_samples=None if unknown is None else unknown[chosen],
            message=self._remark(fits, power, late=density.late),
            extras={
                "objective": squared_error_of(problem, states, density.observation.y),
                "effective_sample_size": fits.effective,
                "power": power,
                "split_r_hat": fits.split_r_hat,
                "lost": fits.lost,
                "fits": fits.asked,
                "games": fits.tried,
                "optima": len(peaks),
            },
        )

    def _weighed(
        self, peak: Peak, fits: Fits, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Points (M, d), their weights (M,), and the power of the density that they stand for."""
        if np.isfinite(fits.log_weights).sum() >= _FEWEST:
            shares, power = fits.tempered(self.enough)
            return fits.points, shares, power
        away = np.linalg.solve(peak.triangle, rng.standard_normal((peak.size, self.count))).T
        return peak.place.points + away, np.full(self.count, 1 / self.count), 0.0

    def _remark(self, fits: Fits, power: float, *, late: bool) -> str:
        """What there is to say about the samples, on one line."""
        said = []
        if power < 1:
            said.append(
                f"the samples are wider than the posterior: it has {fits.effective:.0f} effective "
                f"samples of {self.enough:g}"
            )
        if late:
            said.append("time limit reached")
        if fits.split_r_hat > LARGEST_R_HAT:
            said.append(f"parts of the samples disagree: split R-hat is {fits.split_r_hat:.2f}")
        return "; ".join(said)

    def warm_up(self, problem: Problem) -> None:
        """Build the solvers."""
        warm_up_games(white_problem(problem))


def _nothing(problem: Problem, message: str) -> Estimate:
    known = problem.game.parameters
    return Estimate(
        weights=uniform_weights(problem),
        parameters=known.means if known.count else None,
        converged=False,
        message=message,
    )


def _meant(problem: Problem, optima: Sequence[JointSolution]) -> list[JointSolution]:
    """Optima that are probable enough."""
    limit = 2 * problem.sigma**2 * _MEANT + min((one.criterion for one in optima), default=0.0)
    return [one for one in optima if one.criterion < limit]


def _with_prior(motions: Sequence[Recorded], alpha: float | None) -> list[Recorded]:
    """Motions whose problems have the prior that is asked for, and noise."""
    return [
        replace(
            one,
            problem=replace(
                one.problem,
                sigma=assumed_sigma(one.problem),
                prior=prior_of(motions[0].problem, alpha),
            ),
        )
        for one in motions
    ]


def _covariance(weights: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """(D*K, D*K) of weights (M, D, K) with shares (M,)."""
    flat = weights.reshape(len(weights), -1)
    return np.asarray(np.cov(flat, rowvar=False, aweights=shares))


def different_peaks(density: Density, places: Iterable[Places]) -> list[Peak]:
    """Different peaks near places, the most probable first."""
    found: list[Peak] = []
    for place in places:
        if not place.possible[0]:  # a game at a fold
            continue
        try:
            peak = Peak.at(climbed(density, place))
        except np.linalg.LinAlgError:
            continue
        if all(_apart(peak, other) > _SAME for other in found):
            found.append(peak)
    return sorted(found, key=lambda peak: -float(peak.place.log_density[0]))


def _apart(one: Peak, other: Peak) -> float:
    """Distance in standard deviations."""
    return float(np.linalg.norm(other.triangle @ (one.place.points - other.place.points)[0]))
