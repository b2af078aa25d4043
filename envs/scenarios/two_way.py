"""HighwayEnv's two-way road: a car overtakes on the lane of the oncoming traffic and returns."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from olne_bench.envs.roads.highway_roads import road_network, route
from olne_bench.envs.roads.road_scenario import FAST, Driver, RoadFamily, driving_scenario
from olne_bench.envs.scenarios.player_numbers import PlayerNumber
from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.games.model.lanes import StraightLane

PLAYERS = (3, 5)
OWN, PASSING, ONCOMING = ("a", "b", 1), ("a", "b", 0), ("b", "a", 0)
GAP = (16.0, 22.0)  # [m] behind the first slow car
SPACING = (26.0, 32.0)  # [m] between cars of one direction
PASSING_DISTANCE = (75.0, 90.0)  # [m] that the overtaking car means to spend on the left
ONCOMING_DISTANCE = (270.0, 310.0)  # [m] ahead of the overtaking car
SLOW = (14.0, 16.0)  # [m/s] target speeds
QUICK = (24.0, 27.0)  # [m/s]


@dataclass(frozen=True)
class TwoWay(RoadFamily):
    """One car overtakes against oncoming traffic; each seed draws others."""

    name: ClassVar[str] = "two_way"
    players: ClassVar[tuple[int, int]] = PLAYERS
    speeds: ClassVar[tuple[float, float]] = (SLOW[0], QUICK[1])
    #: N, 3 to 5: one that overtakes, one slow, one oncoming; the fourth starts behind the
    #: overtaking one in the same lane, the fifth is oncoming as well.
    num_players: PlayerNumber = 3

    @staticmethod
    def propose(rng: np.random.Generator, count: int) -> Scenario:
        """One draw, which may be unplayable."""
        start = 100.0
        quick = rng.uniform(*QUICK)
        front = start + rng.uniform(*GAP)
        far = start + rng.uniform(*ONCOMING_DISTANCE)
        drivers = [
            _overtaking(start, quick, start + rng.uniform(*PASSING_DISTANCE)),
            _keeping(OWN, front, rng.uniform(*SLOW)),
            _keeping(ONCOMING, far, rng.uniform(*SLOW)),
            _keeping(OWN, start - rng.uniform(*SPACING), rng.uniform(*SLOW)),
            _keeping(ONCOMING, far + rng.uniform(*SPACING), rng.uniform(*SLOW)),
        ]
        return driving_scenario("two_way", drivers[:count], FAST, rng)


propose = TwoWay.propose


def _keeping(index: tuple[str, str, int], px: float, speed: float) -> Driver:
    network = road_network("two_way")
    lane = network.get_lane(index)
    py, heading = lane.start[1], lane.heading_at(0)
    return Driver((px, float(py), float(heading), speed), route(network, index), speed)


def _overtaking(px: float, speed: float, return_px: float) -> Driver:
    network = road_network("two_way")
    (passing,), (own,) = route(network, PASSING), route(network, OWN)
    py = network.get_lane(OWN).start[1]
    assert isinstance(passing, StraightLane)
    lanes = (replace(passing, length=return_px), own)
    return Driver((px, float(py), 0.0, speed - 3), lanes, speed, blend=8.0)
