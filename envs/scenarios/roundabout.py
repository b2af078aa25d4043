"""HighwayEnv's roundabout: cars on the ring meet cars that enter it."""

from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np

from olne_bench.envs.roads.highway_roads import road_network, route
from olne_bench.envs.roads.road_scenario import TOWN, Driver, RoadFamily, driving_scenario
from olne_bench.envs.scenarios.player_numbers import PlayerNumber
from olne_bench.envs.scenarios.scenario import Scenario

PLAYERS = (2, 4)
RING = ("se", "ex", "ee", "nx", "ne", "wx", "we", "sx")  # nodes in driving order
OUTER = 1  # index of the outer lane of the ring
RING_SPEED = (9.0, 11.0)  # [m/s], target
ENTRY_SPEED = (8.0, 10.0)  # [m/s], target
ENTRY_DISTANCE = (4.0, 20.0)  # [m] from the start of the entry's curve
RING_PLACE = (0.0, 12.0)  # [m] along the ring's segment before the entry


@dataclass(frozen=True)
class Roundabout(RoadFamily):
    """Cars on the ring and cars that enter it; each seed draws others."""

    name: ClassVar[str] = "roundabout"
    players: ClassVar[tuple[int, int]] = PLAYERS
    speeds: ClassVar[tuple[float, float]] = (ENTRY_SPEED[0], RING_SPEED[1])
    #: N, 2 to 4: alternately on the ring west of an entry and on the entry.
    num_players: PlayerNumber = 3

    @staticmethod
    def propose(rng: np.random.Generator, count: int) -> Scenario:
        """One draw, which may be unplayable."""
        sides = ("s", "n")  # two conflicts, on opposite sides of the ring
        drivers = [
            (_circling if index % 2 == 0 else _entering)(rng, sides[index // 2])
            for index in range(count)
        ]
        return driving_scenario("roundabout", drivers, TOWN, rng)


propose = Roundabout.propose


def _circling(rng: np.random.Generator, side: str) -> Driver:
    """A car on the ring, two segments before a side's entry; it takes the second or third exit."""
    first = (RING.index(f"{side}e") - 2) % len(RING)
    return _drive(rng, [], first, 3 + 2 * int(rng.integers(2)), RING_PLACE, RING_SPEED)


def _entering(rng: np.random.Generator, side: str) -> Driver:
    """A car on the access road of a side."""
    access = [(f"{side}er", f"{side}es", 0), (f"{side}es", f"{side}e", 0)]
    first = RING.index(f"{side}e")
    return _drive(rng, access, first, 1 + 2 * int(rng.integers(2)), ENTRY_DISTANCE, ENTRY_SPEED)


def _drive(
    rng: np.random.Generator,
    access: list[tuple[str, str, int]],
    first: int,
    segments: int,
    place: tuple[float, float],
    speeds: tuple[float, float],
) -> Driver:
    network = road_network("roundabout")
    nodes = [RING[(first + k) % len(RING)] for k in range(segments + 1)]
    ring = [(a, b, OUTER) for a, b in pairwise(nodes)]
    leaving = [(nodes[-1], f"{nodes[-1]}s", 0), (f"{nodes[-1]}s", f"{nodes[-1]}r", 0)]
    lane = network.get_lane(access[0] if access else ring[0])
    along = rng.uniform(*place)
    if access:  # counted back from the end of the straight road
        along = lane.length - along
    px, py = lane.position(along, 0)
    speed = rng.uniform(*speeds)
    state = (float(px), float(py), float(lane.heading_at(along)), speed)
    return Driver(state, route(network, *access, *ring, *leaving), speed)
