"""Count the playable first draws of each HighwayEnv family: 100 draws each, by reason.

Certified means locally and globally so far.

Usage: python scripts/highway_draws.py [DRAWS [FAMILY ...]]
"""

import sys
import time
from collections import Counter
from importlib import import_module

import numpy as np

from olne_bench.envs.roads.highway_roads import ROAD_NAMES
from olne_bench.envs.roads.road_scenario import rejection

SIZES = {
    "highway": (3, 4, 5, 6, 7, 8),
    "intersection": (2, 3, 4),
    "merge": (2, 3, 4, 5, 6),
    "roundabout": (2, 3, 4),
    "two_way": (3, 4, 5),
}


def main(draws: int, families: list[str]) -> None:
    """Print one line per family; the number of players cycles through its range."""
    for name in families:
        family = import_module(f"olne_bench.envs.scenarios.{name}")
        reasons: Counter[str] = Counter()
        seconds = []
        for seed in range(draws):
            count = SIZES[name][seed % len(SIZES[name])]
            scenario = family.propose(np.random.default_rng([seed, count, 0]), count)
            start = time.perf_counter()
            reasons[rejection(scenario) or "playable"] += 1
            seconds.append(time.perf_counter() - start)
        certified = draws - reasons["no equilibrium"]
        print(
            f"{name}: {certified} of {draws} certified, {reasons['playable']} playable, "
            f"{reasons['collision']} predicted collisions, "
            f"{reasons['out of limits']} out of limits; "
            f"median {np.median(seconds):.1f} s, longest {max(seconds):.1f} s",
            flush=True,
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100, sys.argv[2:] or list(ROAD_NAMES))
