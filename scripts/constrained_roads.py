"""How often is a constrained game solved that has no potential? Draws of two roads.

python scripts/constrained_roads.py [--draws 50] [--distance 6]

Cars' costs look at other cars (proximity), and any two cars have to keep a hard distance. Draws at
which no motion keeps it from the start on are infeasible, and are counted apart.
"""

import time

import shared
import numpy as np

from olne_bench.envs.scenarios.intersection import Intersection
from olne_bench.envs.scenarios.merge import Merge
from olne_bench.games.solve.constrained import check_start
from olne_bench.games.solve.olne import solve_olne

FAMILIES = (Intersection, Merge)
LEAST_CERTIFIED = 0.97


def main(draws: int = 50, distance: float = 6.0) -> int:
    """Print one line for each road; the exit code says whether enough draws are certified."""
    total = 0
    for family in FAMILIES:
        certified, active, seed, infeasible = 0, 0, 0, 0
        seconds: list[float] = []
        lost: list[int] = []
        plugin = family(distance=distance)
        while len(seconds) < draws:
            seed += 1
            count = plugin.count(seed)
            scenario = plugin.constrained(np.random.default_rng([seed, count, 0]), count)
            try:
                check_start(scenario.game, scenario.initial_state)
            except ValueError:
                infeasible += 1
                continue
            began = time.perf_counter()
            found = solve_olne(scenario.game, scenario.weights, scenario.initial_state)
            seconds.append(time.perf_counter() - began)
            certified += found.certificate.passed
            active += bool(found.active.any())
            if not found.certificate.passed:
                lost.append(seed)
        total += certified
        print(
            f"{family.name}: {certified} of {draws} certified, {active} with active "
            f"constraints, {infeasible} infeasible; median {np.median(seconds):.2f} s with "
            f"certificate; not certified: seeds {lost}",
            flush=True,
        )
    return 0 if total >= LEAST_CERTIFIED * len(FAMILIES) * draws else 1


if __name__ == "__main__":
    shared.command(main)
