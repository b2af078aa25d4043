"""``two_player`` with goals that nobody told: each seed draws them around the published ones.

Estimators know the distribution from which a goal is drawn, as the prior of its two coordinates.
"""

from dataclasses import dataclass, replace
from typing import Any, ClassVar, cast

import numpy as np

from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.envs.scenarios.true_weights import PUBLISHED
from olne_bench.envs.scenarios.two_player import TwoPlayer
from olne_bench.games.model.costs import FinalGoal
from olne_bench.games.model.game import Player
from olne_bench.games.model.unknowns import Unknown

DEVIATION = 0.2  # [m] of each coordinate of a goal, around the published one
REACH = 0.6  # [m] largest deviation


@dataclass(frozen=True)
class UnknownGoals:
    """Two players who cross, towards goals that are drawn; each seed draws others."""

    name: ClassVar[str] = "unknown_goals"
    weights: ClassVar[str] = PUBLISHED  # of all seeds

    def draw(self, seed: int = 0) -> Scenario:
        """The member of a seed."""
        published = TwoPlayer().draw()
        asked = replace(published.game, players=tuple(map(_asked, published.game.players)))
        rng = np.random.default_rng([seed, 7])
        offsets = rng.normal(0, DEVIATION, asked.parameters.means.shape).clip(-REACH, REACH)
        goals = asked.parameters.means + offsets
        return replace(
            published, name=self.name, game=asked.known(goals), asked=asked, parameters=goals
        )


def _asked(player: Player) -> Player:
    """The player, the coordinates of its goal unknown."""
    (goal,) = (feature for feature in player.task if isinstance(feature, FinalGoal))
    unknown = tuple(
        Unknown(f"goal {axis}", "m", mean - REACH, mean + REACH, mean, DEVIATION)
        for axis, mean in zip("xy", goal.goal, strict=True)
    )
    return replace(player, task=(replace(goal, goal=cast(Any, unknown)),))
