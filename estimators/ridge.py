"""A floor beside ``uniform``: the joint problem with a quadratic pull to uniform weights.

    min  |y - h(x)|^2 + (sigma / tau)^2 |theta - 1/K|^2 + sigma^2 |s|^2     (eqn. inverse_approach)

The pull is as strong as the noise level says: tau^2 = (K - 1) / (K^2 (K + 1)) is the variance of
one weight that is uniform on the simplex. Standardised unknowns s have the variance one. Whatever
shrinks towards uniform weights has to beat this. Without noise it is ``kkt_constrained``.

Paper: none; the joint problem of Peters et al., RSS 2021, with a quadratic pull.
Assumes: weights whose mean is uniform, and what ``kkt_constrained`` does.
Cost: that of ``kkt_constrained``.
Trust: as a reference. It claims no region: what shrinks by a Gaussian misses weights near zero.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.certainty import Certainty
from olne_bench.estimators.shared.forward_model import SolvedGame
from olne_bench.estimators.shared.joint_problem import JointSettings
from olne_bench.games.compiled.elimination import Elimination


@dataclass(frozen=True)
class Ridge(KktConstrained):
    """The joint problem with a pull to uniform weights, its strength from the noise level alone.

    Solver and iterations are as of ``kkt_constrained``.
    """

    name: ClassVar[str] = "ridge"

    def _region(self, problem: Problem) -> str | None:
        return None

    def _settings(self, problem: Problem) -> JointSettings:
        pull = problem.sigma**2
        tie = pull / flat_variance(problem.game.num_weights)
        return replace(super()._settings(problem), tie=tie, parameter_tie=pull)

    def _certainty(
        self,
        problem: Problem,
        observations: Sequence[Observation],
        games: Sequence[SolvedGame],
        solver: Elimination | None,
    ) -> Certainty:
        return Certainty(None)


def flat_variance(num_weights: int) -> float:
    """Variance of one weight if all are uniform on the simplex; one if there is one weight."""
    if num_weights == 1:
        return 1.0
    return (num_weights - 1) / (num_weights**2 * (num_weights + 1))
