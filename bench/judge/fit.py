"""How well an estimate explains tracks, and how sure its weights are."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import ndtri

from olne_bench.estimators.protocol import LIKELIHOOD, SAMPLES, Estimate, Observation, Problem
from olne_bench.estimators.shared.fit_test import FitTest, fit_test, not_testable
from olne_bench.estimators.shared.forward_model import game_of_motion
from olne_bench.estimators.shared.noise_level import with_told_noise
from olne_bench.estimators.shared.profile_intervals import profile_intervals
from olne_bench.estimators.shared.white_noise import with_white_noise
from olne_bench.games.model.observation import observe

#: Residuals above this multiple of the noise level are not noise.
FAR_ABOVE_NOISE = 2.0
#: Residuals below this [m] give no warning: positions are rounded to about as much.
NEGLIGIBLE = 0.01
#: Residuals below this [m] have no distribution of noise, where nobody tells its level.
ROUNDING = 1e-3
_TAILS = 0.025, 0.975


@dataclass(frozen=True)
class Fit:
    """An estimate and the observations that it was made from."""

    asked: Problem  # what was known; its sigma is the noise level [m], or its median
    y: np.ndarray  # (T, N, d) observations, NaN where missing
    result: Estimate

    @cached_property
    def problem(self) -> Problem:
        """What is known now: the noise level is that of the estimate where nobody told it."""
        return with_told_noise(self.asked, self.result)

    @cached_property
    def test(self) -> FitTest:
        """Whether noise explains the residuals."""
        if self.asked.sigma_spread and (self.residual or 0.0) < ROUNDING:
            return not_testable(f"residuals are below {ROUNDING:g} m, as rounding leaves them")
        theta = self.result.theta(self.asked.game)
        known = replace(self.problem, sigma_spread=self.asked.sigma_spread)
        return fit_test(known, Observation(self.y), self.result.states, theta)

    @cached_property
    def residuals(self) -> np.ndarray | None:
        """(N,) root mean square residuals [m], over noise scales; None without states."""
        if self.result.states is None:
            return None
        expected = observe(self.problem.view, self.problem.game.dynamics, self.result.states)
        squares = ((self.y - expected) / np.array(self.problem.noise_scale)) ** 2
        return np.asarray(np.sqrt(np.nanmean(squares, axis=(0, 2))))

    @property
    def residual(self) -> float | None:
        """Root mean square residual of all players [m]; None without states."""
        if self.residuals is None:
            return None
        count = np.isfinite(self.y).sum(axis=(0, 2))
        return float(np.sqrt((self.residuals**2 * count).sum() / count.sum()))

    @property
    def standard_errors(self) -> np.ndarray | None:
        """(N, K) standard errors of the weights; None if the estimator gives no covariance.

        If the residual exceeds the noise level, it is used in its place.
        """
        covariance = self.result.covariance
        if covariance is None:
            return None
        excess = max(1.0, (self.residual or 0.0) / self.problem.sigma)
        errors = excess * np.sqrt(np.diag(covariance).clip(0))
        return np.asarray(errors.reshape(self.result.weights.shape))

    def intervals(self, deadline: float = np.inf) -> np.ndarray | None:
        """(N, K, 2) ends of 95 % intervals of the weights; None if the estimator claims nothing.

        From samples they are quantiles, from a covariance normal ones, from a likelihood region the
        referee's own profile: NaN where an end is not found by the deadline, in seconds of
        ``time.monotonic``. A residual above the noise level is used in its place.
        """
        result, errors = self.result, self.standard_errors
        if result.region == SAMPLES and result.samples is not None:
            return np.asarray(np.quantile(result.samples, _TAILS, axis=0)).transpose(1, 2, 0)
        if result.region is None or errors is None or not result.converged:
            return None
        if result.region == LIKELIHOOD and result.states is not None:
            return self._profiled(errors, deadline)
        reach = ndtri(_TAILS[1]) * errors
        ends = np.stack([result.weights - reach, result.weights + reach], axis=-1)
        return np.asarray(ends.clip(0, 1))

    def _profiled(self, errors: np.ndarray, deadline: float) -> np.ndarray | None:
        states = self.result.states
        assert states is not None, "the caller has checked"
        game = self.problem.game
        known = game_of_motion(game, states, self.result.theta(game))
        if known is None:
            return None
        level = max(self.problem.sigma, self.residual or 0.0)
        problem, seen = with_white_noise(replace(self.problem, sigma=level), Observation(self.y))
        return profile_intervals(problem, seen, [known], errors, deadline=deadline)

    @property
    def unexplained(self) -> list[int]:
        """Players whose motion the model does not explain."""
        if self.residuals is None:
            return []
        limit = max(NEGLIGIBLE, FAR_ABOVE_NOISE * self.asked.sigma)
        return [int(i) for i in np.flatnonzero(self.residuals > limit)]
