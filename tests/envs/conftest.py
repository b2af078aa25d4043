"""Draws of roads with few players, which all tests of a process share."""

from functools import cache

from olne_bench.envs.scenarios import Scenario, get_scenario

SMALLEST = {"highway": 3, "intersection": 2, "merge": 2, "roundabout": 2, "two_way": 3}


@cache
def drawn(name: str, seed: int = 0) -> Scenario:
    """A member of a road's family with as few players as it holds."""
    return get_scenario(name, seed, num_players=SMALLEST[name])
