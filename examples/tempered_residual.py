"""The KKT-residual baseline, tempered: the noisier the data, the nearer to equal weights.

The residual method takes errors of the filtered trajectory for preferences, so at high noise its
weights are far out. A mixture with equal weights has less variance, and a bias towards them:

    theta = (1 - s) theta_residual + s / K,    s = sigma / (sigma + half)

Paper: the residual method is that of Rothfuss et al. 2017 and Awasthi and Lamperski 2020; shrinking
    an estimate towards a fixed point is Stein 1956.
Assumes: that the noise level is known, and that weights are no further from equal than noise is
    large.
Cost: that of `kkt_residual`, one convex problem a player.
Trust: where the noise is high and little is known; at low noise `kkt_constrained` is far better.
"""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from olne_bench.estimators.kkt_residual import KktResidual
from olne_bench.estimators.protocol import Observation, Problem


@dataclass(frozen=True)
class TemperedResidual:
    """Weights of the residual method, shrunk towards equal ones."""

    name: ClassVar[str] = "tempered_residual"
    half: float = 0.05  # noise [m] at which both count alike

    def estimate(
        self,
        problem: Problem,
        observation: Observation,
        *,
        rng: np.random.Generator,
        budget: float,
    ) -> Any:
        found = KktResidual().estimate(problem, observation, rng=rng, budget=budget)
        share = problem.sigma / (problem.sigma + self.half)
        weights = (1 - share) * found.weights + share / problem.game.num_weights
        return SimpleNamespace(weights=weights, converged=found.converged, message=found.message)
