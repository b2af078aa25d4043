"""HighwayEnv's highway: fast cars come up behind slow ones and overtake them on the left.

Cars drive in pairs, a fast one behind a slow one in a right lane, the pairs far enough apart for
each fast car to pass its own. The fast cars' task is to keep a left lane.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from olne_bench.envs.roads.highway_roads import road_network, route
from olne_bench.envs.roads.road_scenario import FAST, Driver, RoadFamily, driving_scenario
from olne_bench.envs.scenarios.player_numbers import PlayerNumber
from olne_bench.envs.scenarios.scenario import Scenario

PLAYERS = (3, 8)
LEFT_LANES, RIGHT_LANES = (0, 1), (2, 3)
PAIR_SPACING = 45.0  # [m]
GAP = (14.0, 22.0)  # [m] between the cars of a pair
SLOW = (18.0, 20.0)  # [m/s] target speeds
QUICK = (27.0, 29.0)  # [m/s]


@dataclass(frozen=True)
class Highway(RoadFamily):
    """Pairs of a fast car behind a slow one; each seed draws others."""

    name: ClassVar[str] = "highway"
    players: ClassVar[tuple[int, int]] = PLAYERS
    speeds: ClassVar[tuple[float, float]] = (SLOW[0], QUICK[1])
    num_players: PlayerNumber = 5  # N, 3 to 8

    @staticmethod
    def propose(rng: np.random.Generator, count: int) -> Scenario:
        """One draw, which may be unplayable."""
        drivers = []
        for index in range(count):
            pair, is_fast = divmod(index, 2)
            if not is_fast:
                start_lane, front = rng.choice(RIGHT_LANES), 80 + PAIR_SPACING * pair
                front += rng.uniform(-5, 5)
            px = front - is_fast * rng.uniform(*GAP)
            target_speed = rng.uniform(*(QUICK if is_fast else SLOW))
            speed = target_speed - (rng.uniform(1, 3) if is_fast else 0)
            lane = rng.choice(LEFT_LANES) if is_fast else start_lane
            drivers.append(_driver(px, int(start_lane), speed, int(lane), target_speed))
        return driving_scenario("highway", drivers, FAST, rng)


propose = Highway.propose


def _driver(px: float, start: int, speed: float, target: int, target_speed: float) -> Driver:
    network = road_network("highway")
    py = network.get_lane(("0", "1", start)).position(px, 0)[1]
    lane = route(network, ("0", "1", target))
    return Driver((px, float(py), 0.0, speed), lane, target_speed)
