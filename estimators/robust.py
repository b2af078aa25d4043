"""Estimates that stand noise of an unknown size, with outliers, or with errors that follow others.

Errors have Student's t distribution with nu degrees of freedom and an unknown scale s. With the
residuals r over their noise scale, the most probable motion and scale satisfy

    (T1)  sum w r dr = 0,    s^2 = sum w r^2 / n,    w = (nu + 1) / (nu + r^2 / s^2),

but for the prior, where n is the number of samples less what is fitted. The information of t noise
on its mean is that of Gaussian noise of variance k s^2 with k = (nu + 3) / (nu + 1). So the method
alternates between the scale and an estimator of Gaussian noise that is shown

    (T2)  y* = h(x) + k w (y - h(x))

and told the level sqrt(k) s. Where it stays, (T1) holds, and its uncertainty is as large.

Consecutive errors have the correlation rho. It is found from what the fit leaves, whose expected
correlation is known for each rho; one that white noise would show as well counts as zero. Motions
are smooth, so that such errors hardly move the best fit, and what they leave open grows as if there
were fewer samples, by the factor (1 + rho) / (1 - rho) in the variance.

Paper: iterative re-weighting for t noise (Lange, Little and Taylor 1989); none for games.
Assumes: what the method in use does, but for the noise.
Cost: that of ``map`` five times, then that of the method in use.
Trust: where the noise is not as told. Where it is, regions are a few per cent wider. A bias, or a
    clock that is late, is no noise: see the fit test.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import ClassVar

import numpy as np
from scipy.optimize import brentq

from olne_bench.checks import check_number
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.map import Map
from olne_bench.estimators.posterior import Posterior
from olne_bench.estimators.protocol import (
    COVARIANCE,
    SAMPLES,
    Estimate,
    Estimator,
    Observation,
    Problem,
)
from olne_bench.estimators.shared.forward_model import (
    expected_samples,
    game_of_motion,
    sample_sensitivity,
    scaled_samples,
    squared_error_of,
)
from olne_bench.estimators.shared.noise_level import fitted_part
from olne_bench.estimators.shared.sample_series import steps_apart
from olne_bench.estimators.shared.white_noise import with_white_noise

#: The methods in use, and the one that finds their motion meanwhile.
_METHODS: Mapping[str, tuple[type, type]] = MappingProxyType(
    {
        "kkt_constrained": (KktConstrained, KktConstrained),
        "map": (Map, Map),
        "posterior": (Posterior, Map),
    }
)
#: Rounds at most, and the change of expected samples, in scales of the noise, that ends them.
_ROUNDS, _STILL = 8, 0.03
#: Rounds of the scale.
_SCALE_ROUNDS = 50
#: Samples, less what is fitted, below which the noise that is told is taken for true.
_FEWEST = 10.0
#: A correlation counts from so many standard deviations on; the largest one that is believed.
_SURE, _LARGEST_LAG = 3.0, 0.95


@dataclass(frozen=True)
class Robust:
    """Another method, with noise that it finds itself.

    Raises ValueError on an unknown method or a number out of range.

    Attributes:
        of: the method, ``kkt_constrained``, ``map`` or ``posterior``.
        freedom: degrees of freedom nu of the noise.
    """

    name: ClassVar[str] = "robust"
    of: str = "posterior"
    freedom: float = 4.0

    def __post_init__(self) -> None:
        if self.of not in _METHODS:
            raise ValueError(f"of must be one of {', '.join(_METHODS)}, got {self.of!r}")
        check_number("freedom", self.freedom)

    def estimate(
        self, problem: Problem, observation: Observation, *, rng: np.random.Generator, budget: float
    ) -> Estimate:
        method: Estimator = _METHODS[self.of][0]()
        deadline = time.monotonic() + budget
        white, (seen,) = with_white_noise(problem, observation)
        noise = self._noise(white, seen, deadline, rng) if problem.sigma else None
        if noise is None:  # none, or nothing to find it from
            return method.estimate(problem, observation, rng=rng, budget=budget)
        left = max(0.0, deadline - time.monotonic())
        shown = Observation(noise.shown, seen.extra)
        found = method.estimate(_told(white, noise.level), shown, rng=rng, budget=left)
        extras = {**found.extras, "sigma": noise.sigma, "lag": noise.lag, "far": noise.far}
        if found.states is not None:
            extras["objective"] = squared_error_of(white, found.states, seen.y)
        region = SAMPLES if found.samples is not None else COVARIANCE
        known = found.samples is not None or found.covariance is not None
        return replace(found, region=region if known else None, extras=extras)

    def warm_up(self, problem: Problem) -> None:
        """Build the solvers."""
        for method in dict.fromkeys(_METHODS[self.of]):
            method().warm_up(problem)

    def _noise(
        self, problem: Problem, seen: Observation, deadline: float, rng: np.random.Generator
    ) -> "_Noise | None":
        """The noise, or None where it cannot be found. That of the problem is white."""
        method: Estimator = _METHODS[self.of][1]()
        noise, before = _Noise(seen.y, problem.sigma, problem.sigma), None
        for _ in range(_ROUNDS):
            left = max(0.0, deadline - time.monotonic())
            shown = Observation(noise.shown, seen.extra)
            fit = method.estimate(_told(problem, noise.level), shown, rng=rng, budget=left)
            fitted = _Fitted.of(problem, seen, fit)
            if fitted is None or not np.median(np.abs(fitted.away)):  # who stands is as expected
                return None
            noise = self._seen_in(fitted)
            if before is not None and fitted.moved(before) < _STILL * noise.sigma:
                break
            before = fitted
        return noise

    def _seen_in(self, fitted: "_Fitted") -> "_Noise":
        """The noise in what a fit leaves."""
        away, share = fitted.away, fitted.left / fitted.away.size
        scale = 1.4826 * float(np.median(np.abs(away))) / np.sqrt(share)
        for _ in range(_SCALE_ROUNDS):
            weights = (self.freedom + 1) / (self.freedom + (away / scale) ** 2)
            scale = float(np.sqrt(np.mean(weights * away**2) / share))
        lag, wider = fitted.lag(weights * away)
        wide = (self.freedom + 3) / (self.freedom + 1)
        scale *= wider
        level = scale * np.sqrt(wide * (1 + lag) / (1 - lag))
        far = float(np.mean(np.abs(away) > 3 * scale))
        return _Noise(fitted.shown(wide * weights), scale, level, lag, far)


@dataclass(frozen=True)
class _Noise:
    """What is known of the noise."""

    shown: np.ndarray  # y* of (T2), (T, N, d)
    sigma: float  # its scale s
    level: float  # of Gaussian noise that says as much
    lag: float = 0.0  # correlation of consecutive errors
    far: float = 0.0  # share of the samples that are three scales away


@dataclass(frozen=True)
class _Fitted:
    """A fit and what it leaves; n samples were seen."""

    problem: Problem
    seen: np.ndarray  # (T, N, d) which samples there are
    expected: np.ndarray  # (T, N*d) in units of the noise scale
    away: np.ndarray  # (n,) y - h(x) in these units
    keeps: np.ndarray  # (n, n) what is left of the errors by a fit of them

    @classmethod
    def of(cls, problem: Problem, seen: Observation, fit: Estimate) -> "_Fitted | None":
        """None where there is no regular equilibrium, too few samples, or nothing is left.

        Recorded cars that stand are exactly where they are expected.
        """
        if fit.states is None or not fit.converged:
            return None
        game = game_of_motion(problem.game, fit.states, fit.theta(problem.game))
        if game is None:
            return None
        there = np.isfinite(seen.y)
        try:
            sensitivity = sample_sensitivity(problem, game)
        except ValueError:  # a fold of equilibria
            return None
        free, precision = fitted_part(problem, there, sensitivity)
        sides, sizes, _ = np.linalg.svd(free / np.sqrt(precision), full_matrices=False)
        keeps = np.eye(len(free)) - (sides * (sizes**2 / (sizes**2 + 1))) @ sides.T
        expected = expected_samples(problem, fit.states)
        away = (scaled_samples(problem, seen.y) - expected)[there.reshape(expected.shape)]
        made = cls(problem, there, expected, away, keeps)
        return made if made.left >= _FEWEST and np.median(np.abs(away)) else None

    @property
    def left(self) -> float:
        """Number of samples less what was fitted."""
        return float(np.trace(self.keeps))

    def moved(self, other: "_Fitted") -> float:
        """The largest change of an expected sample."""
        return float(
            np.abs(self.expected - other.expected)[self.seen.reshape(len(self.seen), -1)].max()
        )

    def shown(self, parts: np.ndarray) -> np.ndarray:
        """Samples (T, N, d) that are away by parts (n,) of what these are."""
        flat = np.full(self.expected.shape, np.nan)
        own = self.seen.reshape(flat.shape)
        flat[own] = self.expected[own] + parts * self.away
        return np.asarray(flat.reshape(self.seen.shape) * np.array(self.problem.noise_scale))

    def lag(self, away: np.ndarray) -> tuple[float, float]:
        """The correlation of consecutive errors, and the factor by which a fit hides their size."""
        apart, same = steps_apart(self.seen)
        pairs = np.triu(apart == 1)
        if not pairs.any():
            return 0.0, 1.0
        size = float(away @ away)
        found = float((pairs * np.outer(away, away)).sum()) / max(size, np.finfo(float).tiny)

        def parts(lag: float) -> tuple[float, float]:
            left = self.keeps @ np.where(same, lag**apart, 0.0) @ self.keeps
            return float((left * pairs).sum()), float(np.trace(left))

        products, squares = parts(0.0)
        share = found - products / squares
        if share * len(away) < _SURE * np.sqrt(pairs.sum()):
            return 0.0, 1.0

        def excess(lag: float) -> float:
            ahead, own = parts(lag)
            return ahead / own - found

        lag = _LARGEST_LAG
        if excess(lag) > 0:
            lag = float(brentq(excess, 0.0, _LARGEST_LAG, xtol=1e-3))
        return lag, float(np.sqrt(squares / parts(lag)[1]))


def _told(problem: Problem, sigma: float) -> Problem:
    """A problem whose noise level is known."""
    return replace(problem, sigma=sigma, sigma_spread=0.0)
