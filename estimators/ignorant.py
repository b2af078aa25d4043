"""Another estimator, run in ignorance of the game's hard constraints.

It hands over the problem without them. Beside the same estimator with the constraints, it shows
what knowing them is worth. Forces that constraints exert then look like preferences.

Paper: none; a control experiment.
Assumes: that there are no constraints.
Cost: that of the estimator.
Trust: only where no constraint is active.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from olne_bench.estimators.protocol import COVARIANCE, Estimate, Observation, Problem
from olne_bench.games.model.unknowns import Parameters
from olne_bench.plugins import ESTIMATOR, is_built_in, make, names


@dataclass(frozen=True)
class Ignorant:
    """Runs another estimator on the problem without its constraints.

    Its name is ``of``, its parameters are the default ones. Raises ValueError if there is no such
    built-in estimator: what a parameter names is not shut in as a plugin is.
    """

    name: ClassVar[str] = "ignorant"
    of: str = "kkt_constrained"

    def __post_init__(self) -> None:
        if not is_built_in(ESTIMATOR, self.of):
            known = [name for name in names(ESTIMATOR) if is_built_in(ESTIMATOR, name)]
            raise ValueError(
                f"of must be a built-in estimator, got {self.of!r}; known are: {', '.join(known)}"
            )
        _ = self._estimator

    @cached_property
    def _estimator(self) -> Any:
        return make(ESTIMATOR, self.of, {})

    def estimate(
        self,
        problem: Problem,
        observation: Observation | Sequence[Observation],
        *,
        rng: np.random.Generator,
        budget: float,
    ) -> Estimate:
        estimate: Estimate = self._estimator.estimate(
            _without(problem), observation, rng=rng, budget=budget
        )
        # Its likelihood is that of another game.
        known = replace(estimate, region=None if estimate.covariance is None else COVARIANCE)
        return _with_priors(problem.game.parameters, known)

    def supports(self, problem: Problem) -> str | None:
        """The reason why the estimator cannot take the problem, or None."""
        if not hasattr(self._estimator, "supports"):
            return None
        reason: str | None = self._estimator.supports(_without(problem))
        return reason

    def warm_up(self, problem: Problem) -> None:
        """Build the estimator's solvers."""
        if hasattr(self._estimator, "warm_up"):
            self._estimator.warm_up(_without(problem))


def _with_priors(asked: Parameters, estimate: Estimate) -> Estimate:
    """The estimate; of unknowns of the constraints, which it ignores, it has the priors."""
    if not asked.count:
        return estimate
    values, deviations = asked.means.copy(), asked.deviations.copy()
    for all_of_them, found in (
        (values, estimate.parameters),
        (deviations, estimate.parameter_deviations),
    ):
        if found is not None:  # those of features come first
            own = all_of_them[:, : found.shape[1]]
            own[np.isfinite(found)] = found[np.isfinite(found)]
    unsaid = estimate.parameters is not None and estimate.parameter_deviations is None
    return replace(estimate, parameters=values, parameter_deviations=None if unsaid else deviations)


def _without(problem: Problem) -> Problem:
    return replace(problem, game=replace(problem.game, constraints=()))
