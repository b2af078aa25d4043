"""HighwayEnv's merge: cars on the ramp join the right lane of a highway with cars on it."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from olne_bench.envs.roads.highway_roads import road_network, route
from olne_bench.envs.roads.road_scenario import FAST, Driver, RoadFamily, driving_scenario
from olne_bench.envs.scenarios.player_numbers import PlayerNumber
from olne_bench.envs.scenarios.scenario import Scenario

PLAYERS = (2, 6)
RAMP, LEFT, RIGHT = ("k", "b", 0), ("a", "b", 0), ("a", "b", 1)
AFTER_RAMP = ("b", "c", 1)  # the right lane where the ramp meets it
SPACING = 22.0  # [m] between neighbours, alternately on the ramp and on the right lane
JITTER = 4.0  # [m]
SPEED = (21.0, 25.0)  # [m/s], target
LEFT_SPEED = (25.0, 28.0)  # [m/s], target on the left lane


@dataclass(frozen=True)
class Merge(RoadFamily):
    """Cars on a ramp join the right lane of a highway; each seed draws others."""

    name: ClassVar[str] = "merge"
    players: ClassVar[tuple[int, int]] = PLAYERS
    speeds: ClassVar[tuple[float, float]] = (SPEED[0], LEFT_SPEED[1])
    num_players: PlayerNumber = 4  # N, 2 to 6

    @staticmethod
    def propose(rng: np.random.Generator, count: int) -> Scenario:
        """One draw, which may be unplayable."""
        network = road_network("merge")
        drivers = []
        for index in range(count):
            px = 180 - SPACING * (index // 3) - 8 * (index % 3) + rng.uniform(-JITTER, JITTER)
            start = (RAMP, RIGHT, LEFT)[index % 3]
            target_speed = rng.uniform(*(LEFT_SPEED if start == LEFT else SPEED))
            lane = network.get_lane(start)
            along = px - lane.position(0, 0)[0]
            py, heading = lane.position(along, 0)[1], lane.heading_at(along)
            state = (px, float(py), float(heading), target_speed - rng.uniform(0, 2))
            lanes = (RAMP, AFTER_RAMP) if start == RAMP else (start,)
            drivers.append(Driver(state, route(network, *lanes), target_speed, blend=5.0))
        return driving_scenario("merge", drivers, FAST, rng)


propose = Merge.propose
