"""The most probable weights: the joint problem with a prior in it.

Each player's weights have a Dirichlet prior with all parameters alpha; alpha = 1 is flat. It is
taken as a density of their log-ratios, the simplex's own chart, whose Jacobian is prod_k theta_k.
Standardised unknowns s have a standard normal prior. With Gaussian noise, minus the logarithm of
the posterior times 2 sigma^2 is

    min  |y - h(x)|^2 - 2 sigma^2 alpha sum_ik log theta_ik + sigma^2 |s|^2.       (M1)

The second term is the barrier of the interior point method (``interior_point``), which stops at
2 sigma^2 alpha instead of going to zero. So no weight is zero, and no start is lost at a corner.
Without noise (M1) is ``kkt_constrained``. IPOPT takes the term as part of its objective.

The covariance is Laplace's approximation in log-ratios, mapped to the weights: the curvature of the
prior, alpha K (diag theta - theta theta'), is alpha K diag(1 / theta) on the simplex.

Paper: none; the joint problem of Peters et al., RSS 2021, with a prior.
Assumes: a prior of the weights, and what ``kkt_constrained`` does.
Cost: that of ``kkt_constrained``.
Trust: more than the maximum-likelihood estimate where the noise is high, and no less elsewhere. Its
    covariance is no better than a Gaussian at one optimum can be.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import ClassVar

import numpy as np

from olne_bench.checks import check_number
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.certainty import Certainty, posterior_covariance
from olne_bench.estimators.shared.forward_model import SolvedGame
from olne_bench.estimators.shared.joint_problem import JointSettings, JointSolution
from olne_bench.estimators.shared.joint_starts import Search, all_starts, spread_starts
from olne_bench.games.compiled.elimination import Elimination

#: Starts at weights spread over the simplex that ``probable_optima`` adds.
_SPREAD = 4


@dataclass(frozen=True)
class Map(KktConstrained):
    """The most probable point under a Dirichlet prior of the weights.

    Attributes:
        solver: as of ``kkt_constrained``.
        max_iterations: as of ``kkt_constrained``.
        alpha: parameter of the Dirichlet distribution; 1 is flat.

    Raises:
        ValueError: on a parameter out of range.
    """

    name: ClassVar[str] = "map"
    _region: ClassVar[str | None] = None
    alpha: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_number("alpha", self.alpha)

    def _settings(self, problem: Problem) -> JointSettings:
        return with_prior(super()._settings(problem), problem.sigma, self.alpha)

    def _certainty(
        self,
        problem: Problem,
        observations: Sequence[Observation],
        games: Sequence[SolvedGame],
        solver: Elimination | None,
    ) -> Certainty:
        weights, floor = games[0].weights, problem.weight_floor
        free = 1 - problem.game.num_weights * floor
        shares = (weights - floor) / free
        precision = self.alpha * problem.game.num_weights / (shares * free**2)
        return Certainty(posterior_covariance(problem, observations, games, solver, precision))


def with_prior(settings: JointSettings, sigma: float, alpha: float) -> JointSettings:
    """The settings of (M1)."""
    return replace(settings, barrier=2 * sigma**2 * alpha, parameter_tie=sigma**2)


def probable_optima(
    problem: Problem, y: np.ndarray, alpha: float, deadline: float
) -> list[JointSolution]:
    """All optima of (M1) that starts find, the most probable first.

    More starts than an estimate needs are tried: all of ``joint_starts``, settled or not.

    Args:
        problem: what is known; its noise is white.
        y: (T, N, d) observations, NaN where missing.
        alpha: parameter of the Dirichlet distribution.
        deadline: solves end by then, in seconds of ``time.monotonic``.
    """
    plain = JointSettings(noise_scale=problem.noise_scale, weight_floor=problem.weight_floor)
    search = Search(problem, y, with_prior(plain, problem.sigma, alpha), deadline)
    for start, barrier in all_starts(problem, y, search):
        search.attempt(start, barrier)
    for start in islice(spread_starts(problem, y), None if not search.explained else _SPREAD):
        search.attempt(start)
    return sorted(search.known, key=lambda one: one.criterion)
