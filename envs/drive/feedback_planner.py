"""An ego that plays its part of a feedback equilibrium: all see each other and answer at each step.

It expects what the strategies of all do from here, and drives the first control of its own. The
feedback game has no hard distance, so where that motion comes nearer than the least gap, the ego
drives its best response to it that keeps the distance. Where no equilibrium is found, it plans by
the open-loop one.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from olne_bench.envs.drive.planner import (
    CONSTRAINED,
    LEAST_GAP,
    EgoPlan,
    GamePlanner,
    Mind,
    ego_response,
    plans_alone,
)
from olne_bench.envs.roads.footprint import gap
from olne_bench.games.model.game import Game
from olne_bench.games.solve.feedback import solve_feedback


class FeedbackPlanner(GamePlanner):
    """Plans by the feedback equilibrium of the ego and the others."""

    def _found(
        self, game: Game, minds: Sequence[Mind], numbers: tuple[int, ...], states: np.ndarray
    ) -> EgoPlan | None:
        free, weights = replace(game, constraints=()), np.stack([mind.weights for mind in minds])
        former = self._shifted(numbers, states)
        first = plans_alone(free, weights, states) if former is None else former.controls
        found = solve_feedback(free, weights, states, initial_controls=first)
        if not found.converged:
            return super()._found(game, minds, numbers, states)
        motion, controls, kind = found.states.copy(), found.controls.copy(), CONSTRAINED
        if gap(motion[:, :1], motion[:, 1:]).min(initial=np.inf) < LEAST_GAP:
            own = ego_response(game, motion, controls, minds[0].weights)
            if own is None:
                return None
            motion[:, 0], controls[:, 0], kind = own
        return EgoPlan(numbers, motion, controls, np.zeros_like(motion[1:]), kind)
