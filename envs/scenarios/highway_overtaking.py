"""The paper's highway: five vehicles on two lanes, faster ones overtake.

Peters et al. 2021, Sec. 5-Player Highway Overtaking; parameters of the published experiments, in
their normalised units. The road runs along y.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from olne_bench.envs.scenarios.scenario import Limits, Scenario
from olne_bench.envs.scenarios.true_weights import PublishedOrDrawn
from olne_bench.games.model.costs import ControlEffort, Proximity, StateDeviation
from olne_bench.games.model.dynamics import UNICYCLE
from olne_bench.games.model.game import Game, Player

HORIZON = 20
DT = 1.0  # [s]
ROAD_HEADING = np.pi / 2  # [rad]
#: Controls well beyond those of equilibria, and states that they can reach.
LIMITS = Limits(controls=(1.0, 0.5), states=(100.0, 100.0, 21.0, 10.0))
#: With drawn weights: who minds a control little uses much of it.
WIDE_LIMITS = Limits(controls=(10.0, 5.0), states=(1000.0, 1000.0, 192.0, 100.0))


#: Of each car: px, py and speed at the start, px of its lane, target speed, proximity weight.
CARS = (
    (1, 0, 0.2, 0, 0.3, 0.3),
    (0, -3, 0.4, 0, 0.4, 0.3),
    (1, 2, 0.1, 1, 0.1, 0.05),
    (1, 4, 0.1, 1, 0.1, 0.05),
    (0, 6, 0.3, 1, 0.2, 0.3),
)


@dataclass(frozen=True)
class HighwayOvertaking(PublishedOrDrawn):
    """Five cars that overtake, as published or with weights that each seed draws."""

    name: ClassVar[str] = "highway_overtaking"

    def draw(self, seed: int = 0) -> Scenario:
        """The scenario."""
        return Scenario(
            name=self.name,
            game=Game(tuple(_player(*car[3:5]) for car in CARS), UNICYCLE, HORIZON, DT),
            weights=self.drawn(np.array([[car[-1], 1, 1, 1] for car in CARS]), seed),
            initial_state=np.array([[px, py, ROAD_HEADING, speed] for px, py, speed, *_ in CARS]),
            limits=LIMITS if self.fixed else WIDE_LIMITS,
        )


def _player(lane_x: float, target_speed: float) -> Player:
    return Player(
        preferences=(
            Proximity(),
            StateDeviation("speed", target=target_speed),
            ControlEffort("acceleration", scale=10.0),
            ControlEffort("yaw_rate"),
        ),
        task=(
            StateDeviation("px", target=lane_x),
            StateDeviation("heading", target=ROAD_HEADING, scale=2.0),
        ),
    )
