"""HighwayEnv's intersection: cars from different arms cross, turn left or turn right."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from olne_bench.envs.roads.highway_roads import road_network, route
from olne_bench.envs.roads.road_scenario import TOWN, Driver, RoadFamily, driving_scenario
from olne_bench.envs.scenarios.player_numbers import PlayerNumber
from olne_bench.envs.scenarios.scenario import Scenario

PLAYERS = (2, 4)
ARMS = 4
TURNS = (1, 2, 3)  # arms further on: left, straight, right
SPEED = (7.0, 10.0)  # [m/s], target
DISTANCE = (8.0, 13.0)  # [m] of the first car from the stop line
SPACING = 8.0  # [m] that each further car is farther away


@dataclass(frozen=True)
class Intersection(RoadFamily):
    """Cars that cross or turn; each seed draws others."""

    name: ClassVar[str] = "intersection"
    players: ClassVar[tuple[int, int]] = PLAYERS
    speeds: ClassVar[tuple[float, float]] = SPEED
    num_players: PlayerNumber = 3  # N, 2 to 4, each from another arm

    @staticmethod
    def propose(rng: np.random.Generator, count: int) -> Scenario:
        """One draw, which may be unplayable."""
        arms = rng.permutation(ARMS)[:count]
        drivers = [_driver(rng, int(arm), SPACING * rank) for rank, arm in enumerate(arms)]
        return driving_scenario("intersection", drivers, TOWN, rng)


propose = Intersection.propose


def _driver(rng: np.random.Generator, arm: int, farther: float) -> Driver:
    network = road_network("intersection")
    out = (arm + int(rng.choice(TURNS))) % ARMS
    lanes = [(f"o{arm}", f"ir{arm}", 0), (f"ir{arm}", f"il{out}", 0), (f"il{out}", f"o{out}", 0)]
    access = network.get_lane(lanes[0])
    along = access.length - rng.uniform(*DISTANCE) - farther
    px, py = access.position(along, 0)
    speed = rng.uniform(*SPEED)
    state = (float(px), float(py), float(access.heading_at(along)), speed)
    return Driver(state, route(network, *lanes), speed)
