"""The paper's running example: two vehicles cross and avoid each other.

Peters et al. 2021, Sec. Background and Sec. 2-Player Running Example; parameters of the published
experiments, in their normalised units. Each player starts on the unit circle, ten degrees off the
direction to its goal on the other side.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from olne_bench.envs.scenarios.scenario import Limits, Scenario
from olne_bench.envs.scenarios.true_weights import PublishedOrDrawn
from olne_bench.games.model.costs import ControlEffort, FinalGoal, Proximity, StateDeviation
from olne_bench.games.model.dynamics import UNICYCLE
from olne_bench.games.model.game import Game, Player

HORIZON = 25
DT = 0.25  # [s]
DIRECTIONS = (0.0, np.pi / 2)  # [rad] from start to goal
HEADING_OFFSET = np.deg2rad(10)  # [rad]
INITIAL_SPEED = 0.1  # [m/s]
#: Controls well beyond those of equilibria, and states that they can reach.
LIMITS = Limits(controls=(1.0, 1.0), states=(20.0, 20.0, 8.0, 7.0))
#: With drawn weights: who minds a control little uses much of it.
WIDE_LIMITS = Limits(controls=(30.0, 20.0), states=(400.0, 400.0, 192.0, 126.0))


@dataclass(frozen=True)
class TwoPlayer(PublishedOrDrawn):
    """Two players who cross, as published or with weights that each seed draws."""

    name: ClassVar[str] = "two_player"

    def draw(self, seed: int = 0) -> Scenario:
        """The scenario."""
        return Scenario(
            name=self.name,
            game=Game(tuple(_player(d) for d in DIRECTIONS), UNICYCLE, HORIZON, DT),
            weights=self.drawn(np.ones((2, 4)), seed),
            initial_state=np.array(
                [[-np.cos(d), -np.sin(d), d + HEADING_OFFSET, INITIAL_SPEED] for d in DIRECTIONS]
            ),
            limits=LIMITS if self.fixed else WIDE_LIMITS,
        )


def _player(direction: float) -> Player:
    return Player(
        preferences=(
            Proximity(),
            StateDeviation("speed"),
            ControlEffort("acceleration", scale=10.0),
            ControlEffort("yaw_rate"),
        ),
        task=(FinalGoal((float(np.cos(direction)), float(np.sin(direction)))),),
    )
