"""HighwayEnv's merge: cars on the ramp join the right lane of a highway with cars on it."""

from functools import partial

import numpy as np

from olne_bench.envs.driving import (
    FAST,
    Driver,
    check_num_players,
    draw_playable,
    draw_weights,
    driving_scenario,
)
from olne_bench.envs.highway_roads import road_network, route
from olne_bench.envs.scenarios.scenario import Scenario

PLAYERS = (2, 6)
RAMP, LEFT, RIGHT = ("k", "b", 0), ("a", "b", 0), ("a", "b", 1)
AFTER_RAMP = ("b", "c", 1)  # the right lane where the ramp meets it
SPACING = 22.0  # [m] between neighbours, alternately on the ramp and on the right lane
JITTER = 4.0  # [m]
SPEED = (21.0, 25.0)  # [m/s], target
LEFT_SPEED = (25.0, 28.0)  # [m/s], target on the left lane


def make(seed: int = 0, num_players: int = 4) -> Scenario:
    """One draw.

    Args:
        seed: of the draw.
        num_players: N, 2 to 6.
    """
    check(num_players)
    return draw_playable("merge", partial(draw, count=num_players), seed, num_players)


def check(num_players: int = 4) -> None:
    """Refuse what ``make`` refuses."""
    check_num_players("merge", num_players, *PLAYERS)


def draw(rng: np.random.Generator, count: int) -> Scenario:
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
    return driving_scenario("merge", drivers, FAST, draw_weights(rng, count))
