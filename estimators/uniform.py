"""The floor: equal weights, whatever is observed. Every estimator must beat it."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from estimators.protocol import Estimate, Observation, Problem, check_observation


@dataclass(frozen=True)
class Uniform:
    """Gives every cost feature of every player the same weight."""

    name: ClassVar[str] = "uniform"

    def estimate(
        self,
        problem: Problem,
        observation: Observation,
        *,
        rng: np.random.Generator,
        budget: float,
    ) -> Estimate:
        check_observation(problem, observation)
        shape = (problem.game.num_players, problem.game.num_weights)
        return Estimate(weights=np.full(shape, 1 / shape[1]))
