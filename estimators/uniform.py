"""The floor: equal weights for any observation. Every estimator must beat it.

Assumes: nothing.
Cost: none.
Trust: as a reference only; in `two_player` it is the truth, unless weights are drawn.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from olne_bench.estimators.protocol import Estimate, Observation, Problem, check_observations


@dataclass(frozen=True)
class Uniform:
    """Gives every cost feature of every player the same weight, and unknowns their mean."""

    name: ClassVar[str] = "uniform"
    several: ClassVar[bool] = True

    def estimate(
        self,
        problem: Problem,
        observation: Observation | Sequence[Observation],
        *,
        rng: np.random.Generator,
        budget: float,
    ) -> Estimate:
        check_observations(problem, observation)
        shape = (problem.game.num_players, problem.game.num_weights)
        known = problem.game.parameters
        return Estimate(
            weights=np.full(shape, 1 / shape[1]), parameters=known.means if known.count else None
        )
