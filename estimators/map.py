"""The most probable weights: the joint problem with a prior in it.

Each player's weights have the problem's prior, a Dirichlet distribution with parameters alpha_k
(flat if all are 1). It is taken as a density of their log-ratios, the simplex's own chart, whose
Jacobian is prod_k theta_k. Standardised unknowns s have a standard normal prior. With Gaussian
noise, minus the logarithm of the posterior times 2 sigma^2 is

    min  |y - h(x)|^2 - 2 sigma^2 sum_ik alpha_k log theta_ik + sigma^2 |s|^2.       (M1)

The second term is the barrier of the interior point method (``interior_point``), which stops at
2 sigma^2 alpha instead of going to zero. So no weight is zero, and no start is lost at a corner.
Without noise (M1) is ``kkt_constrained``. IPOPT takes the term as part of its objective.

A mixture of such priors begins at the one distribution with its mean and spread. Then (M1) is
solved again with the parameters of the distribution that touches the mixture from below at the last
optimum, which never makes a point less probable (expectation maximisation), until weights stay.

The covariance is Laplace's approximation in log-ratios, mapped to the weights: the curvature of the
prior, A (diag theta - theta theta') with A = sum_k alpha_k, is A diag(1 / theta) on the simplex.

Paper: none; the joint problem of Peters et al., RSS 2021, with a prior.
Assumes: a prior of the weights, and what ``kkt_constrained`` does.
Cost: that of ``kkt_constrained``.
Trust: more than the maximum-likelihood estimate where the noise is high, and no less elsewhere. Its
    covariance is no better than a Gaussian at one optimum can be.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import ClassVar

import numpy as np

from olne_bench.checks import check_number
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.protocol import POSTERIOR, Observation, Problem
from olne_bench.estimators.shared.certainty import Certainty, posterior_covariance
from olne_bench.estimators.shared.forward_model import SolvedGame
from olne_bench.estimators.shared.interior_point import solve_joint_motions
from olne_bench.estimators.shared.joint_problem import (
    JointSettings,
    JointSolution,
    SeenMotion,
    weights_of,
)
from olne_bench.estimators.shared.joint_starts import Search, all_starts, spread_starts
from olne_bench.games.compiled.elimination import Elimination
from olne_bench.games.model.weight_prior import WeightPrior

#: Starts at weights spread over the simplex that ``probable_optima`` adds.
_SPREAD = 4

#: Rounds under a mixture at most, the change of weights that ends them, and their first barrier.
_ROUNDS, _STILL, _NEAR = 8, 1e-4, 1e-3


@dataclass(frozen=True)
class Map(KktConstrained):
    """The most probable point under a prior of the weights.

    Raises ValueError on a parameter out of range.

    Attributes:
        solver: as of ``kkt_constrained``.
        max_iterations: as of ``kkt_constrained``.
        alpha: parameter of a symmetric Dirichlet distribution in place of the problem's prior.
    """

    name: ClassVar[str] = "map"
    alpha: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_alpha(self.alpha)

    def _region(self, problem: Problem) -> str | None:
        own = prior_of(problem, self.alpha) != problem.prior
        return None if own else POSTERIOR  # the referee's has the problem's prior

    def _settings(self, problem: Problem) -> JointSettings:
        return with_prior(super()._settings(problem), problem, prior_of(problem, self.alpha))

    def _attempts(self, problem: Problem, y: np.ndarray, deadline: float) -> list[JointSolution]:
        attempts = super()._attempts(problem, y, deadline)
        motion = SeenMotion(problem.game, problem.view, y, problem.noise_scale)
        return self._refined(problem, [motion], attempts, deadline)

    def _together(
        self, problems: Sequence[Problem], motions: Sequence[SeenMotion], deadline: float
    ) -> list[JointSolution]:
        attempts = super()._together(problems, motions, deadline)
        return self._refined(problems[0], motions, attempts, deadline)

    def _refined(
        self,
        problem: Problem,
        motions: Sequence[SeenMotion],
        attempts: list[JointSolution],
        deadline: float,
    ) -> list[JointSolution]:
        prior = prior_of(problem, self.alpha)
        if len(prior.shares) == 1 or self._uses_ipopt:
            return attempts
        settings = self._structured_settings(problem)
        return [refined(problem, motions, one, settings, prior, deadline) for one in attempts]

    def _certainty(
        self,
        problem: Problem,
        observations: Sequence[Observation],
        games: Sequence[SolvedGame],
        solver: Elimination | None,
    ) -> Certainty:
        precision = self._precision(problem, games[0].weights)
        return Certainty(posterior_covariance(problem, observations, games, solver, precision))

    def _precision(self, problem: Problem, weights: np.ndarray) -> np.ndarray:
        floor, free = problem.weight_floor, 1 - problem.game.num_weights * problem.weight_floor
        shares = (weights - floor) / free
        total = prior_of(problem, self.alpha).effective(shares).sum(axis=1, keepdims=True)
        return np.asarray(total / (shares * free**2))


def check_alpha(alpha: float | None) -> None:
    """Refuse a Dirichlet parameter; ValueError unless it is positive and finite, or None."""
    if alpha is not None:
        check_number("alpha", alpha)


def prior_of(problem: Problem, alpha: float | None) -> WeightPrior:
    """The problem's prior of weights, or the symmetric one that an estimator takes instead."""
    return problem.prior if alpha is None else WeightPrior((float(alpha),))


def with_prior(settings: JointSettings, problem: Problem, prior: WeightPrior) -> JointSettings:
    """The settings of (M1), of a mixture at the one distribution with its mean and spread."""
    return _touching(settings, problem.sigma, prior.matched(problem.game.num_weights))


def _touching(settings: JointSettings, sigma: float, alpha: np.ndarray) -> JointSettings:
    return replace(settings, barrier=2 * sigma**2 * alpha, parameter_tie=sigma**2)


def refined(
    problem: Problem,
    motions: Sequence[SeenMotion],
    solution: JointSolution,
    settings: JointSettings,
    prior: WeightPrior,
    deadline: float,
) -> JointSolution:
    """An optimum of (M1) under a mixture, from one under another prior; that one if none."""
    floor, free = problem.weight_floor, 1 - problem.game.num_weights * problem.weight_floor
    for _ in range(_ROUNDS if solution.converged else 0):
        weights = weights_of(motions, solution.points)
        shares = (weights - floor) / free
        own = replace(
            _touching(settings, problem.sigma, prior.effective(shares)),
            first_barrier=_NEAR,
            limit=max(0.0, deadline - time.monotonic()),
        )
        found = solve_joint_motions(motions, solution.points, own)
        if not found.converged:
            break
        moved = np.abs(weights_of(motions, found.points) - weights).max()
        solution = found
        if moved < _STILL:
            break
    shares = (weights_of(motions, solution.points) - floor) / free
    unknown = sum(float((values**2).sum()) for values in _own_unknowns(motions, solution))
    likely = 2 * float(prior.log_density(shares).sum())
    return replace(solution, penalty=problem.sigma**2 * (unknown - likely))


def _own_unknowns(motions: Sequence[SeenMotion], solution: JointSolution) -> Iterator[np.ndarray]:
    """Standardised unknowns, once for motions of one situation."""
    known = set()
    for one, point in zip(motions, solution.points, strict=True):
        if point.parameters is not None and one.situation not in known:
            yield point.parameters
        if one.situation is not None:
            known.add(one.situation)


def probable_optima(
    problem: Problem, y: np.ndarray, prior: WeightPrior, deadline: float
) -> list[JointSolution]:
    """All optima of (M1) that starts find, the most probable first; the noise is white.

    All of ``joint_starts`` are tried, settled or not, for observations y (T, N, d), until the
    deadline, in seconds of ``time.monotonic``.
    """
    plain = JointSettings(noise_scale=problem.noise_scale, weight_floor=problem.weight_floor)
    search = Search.of(problem, y, with_prior(plain, problem, prior), deadline)
    for start, barrier in all_starts(problem, y, search):
        search.attempt(start, barrier)
    for start in islice(spread_starts(problem, y), None if not search.explained else _SPREAD):
        search.attempt(start)
    known = search.known
    if len(prior.shares) > 1:
        known = [refined(problem, search.motions, one, plain, prior, deadline) for one in known]
    return sorted(known, key=lambda one: one.criterion)
