"""How well an estimate explains tracks, and how sure its weights are."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from olne_bench.bench.judge.estimate_check import CheckedEstimate
from olne_bench.estimators.protocol import Problem
from olne_bench.games.observation import observe

#: Residuals beyond so many times the noise are not noise.
FAR_ABOVE_NOISE = 2.0
#: Below this residual [m] nothing is said: it is about what positions are rounded to.
NEGLIGIBLE = 0.01


@dataclass(frozen=True)
class Fit:
    """An estimate beside what was observed.

    Attributes:
        problem: its sigma is the noise level [m].
        y: (T, N, d) observations, NaN where missing.
        result: the estimate.
    """

    problem: Problem
    y: np.ndarray
    result: CheckedEstimate

    @cached_property
    def residuals(self) -> np.ndarray | None:
        """(N,) root mean squares, in units of the noise on positions [m]; None if unknown.

        Every component counts relative to its noise scale.
        """
        if self.result.states is None:
            return None
        expected = observe(self.problem.view, self.problem.game.dynamics, self.result.states)
        squares = ((self.y - expected) / np.array(self.problem.noise_scale)) ** 2
        return np.sqrt(np.nanmean(squares, axis=(0, 2)))

    @property
    def residual(self) -> float | None:
        """Root mean square of all of them [m]."""
        if self.residuals is None:
            return None
        count = np.isfinite(self.y).sum(axis=(0, 2))
        return float(np.sqrt((self.residuals**2 * count).sum() / count.sum()))

    @property
    def standard_errors(self) -> np.ndarray | None:
        """(N, K) of the weights; None where the estimator gives no covariance.

        Where residuals exceed the noise, they are taken for it.
        """
        covariance = self.result.covariance
        if covariance is None:
            return None
        excess = max(1.0, (self.residual or 0.0) / self.problem.sigma)
        errors = excess * np.sqrt(np.diag(covariance).clip(0))
        return np.asarray(errors.reshape(self.result.weights.shape))

    @property
    def unexplained(self) -> list[int]:
        """Players whose motion the model does not explain."""
        if self.residuals is None:
            return []
        limit = max(NEGLIGIBLE, FAR_ABOVE_NOISE * self.problem.sigma)
        return [int(i) for i in np.flatnonzero(self.residuals > limit)]
