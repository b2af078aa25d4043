"""An ego that plays its part of a feedback equilibrium: all see each other and answer at each step.

It expects what the strategies of all do from here, and drives the first control of its own. The
feedback game has no hard distance, so where that motion comes nearer than the least gap, the ego
drives its best response to it that keeps the distance. Where no equilibrium is found, it plans by
the open-loop one.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from olne_bench.envs.drive.cars import Mind, least_gaps
from olne_bench.envs.drive.planner import (
    CONSTRAINED,
    EgoPlan,
    GamePlanner,
    planned_game,
    planned_response,
    plans_alone,
)
from olne_bench.envs.drive.response import LEAST_GAP
from olne_bench.games.solve.feedback import solve_feedback


class FeedbackPlanner(GamePlanner):
    """Plans by the feedback equilibrium of the ego and the others."""

    def _found(
        self, minds: Sequence[Mind], numbers: tuple[int, ...], states: np.ndarray
    ) -> EgoPlan | None:
        free = replace(planned_game(minds), constraints=())
        weights, former = np.stack([mind.weights for mind in minds]), self._shifted(numbers, states)
        first = plans_alone(free, weights, states) if former is None else former.controls
        found = solve_feedback(free, weights, states, initial_controls=first)
        if not found.converged:
            return super()._found(minds, numbers, states)
        motion, controls = found.states, found.controls
        if least_gaps(motion).min() < LEAST_GAP:
            return planned_response(minds[0], numbers, motion, controls)
        return EgoPlan(numbers, motion, controls, np.zeros_like(motion[1:]), CONSTRAINED)
