"""How well an estimate explains tracks, and how sure its weights are."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from olne_bench.bench.judge.estimate_check import CheckedEstimate
from olne_bench.estimators.protocol import Problem
from olne_bench.games.observation import observe

#: Residuals above this multiple of the noise level are not noise.
FAR_ABOVE_NOISE = 2.0
#: Residuals below this [m] give no warning: positions are rounded to about as much.
NEGLIGIBLE = 0.01


@dataclass(frozen=True)
class Fit:
    """An estimate and the observations that it was made from.

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
        """(N,) root mean square residuals [m]; None if the estimator gives no states.

        Each component is divided by its noise scale.
        """
        if self.result.states is None:
            return None
        expected = observe(self.problem.view, self.problem.game.dynamics, self.result.states)
        squares = ((self.y - expected) / np.array(self.problem.noise_scale)) ** 2
        return np.sqrt(np.nanmean(squares, axis=(0, 2)))

    @property
    def residual(self) -> float | None:
        """Root mean square residual of all players [m]; None if the estimator gives no states."""
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

    @property
    def unexplained(self) -> list[int]:
        """Players whose motion the model does not explain."""
        if self.residuals is None:
            return []
        limit = max(NEGLIGIBLE, FAR_ABOVE_NOISE * self.problem.sigma)
        return [int(i) for i in np.flatnonzero(self.residuals > limit)]
