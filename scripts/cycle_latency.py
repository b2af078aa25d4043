"""How long an ego takes for a cycle of a drive: an estimate of the others, and a plan.

    python scripts/cycle_latency.py [--drives 10] [--road highway] [--method map]

Drives are those of the suite ``driving``, with Nash traffic, its window and noise, on one core and
in one process. Counts cycles with five cars, the ego and four others. A cycle is warm if its stream
and its former plan are about the same cars and the stream goes on; a stream that begins updates
with each sample of its window. Prints the median and the 95 % and 99 % percentiles [ms] of warm and
of all cycles: of the estimate, of the plan, and of both, in processor time and wall-clock time.
"""

import time
from typing import Annotated

import shared
import numpy as np
from beliefs_here import RULES, Here, beliefs_here

from olne_bench.envs.drive.cars import ROADS
from olne_bench.envs.drive.planner import GamePlanner
from olne_bench.envs.drive.world import DriveWorld, NoDriveError, seen

CARS = 5
LEVELS = (50, 95, 99)
FIRST_SEED = 20_000_000  # of drives that compile what is needed; the next ones count


def main(drives: int = 10, road: Annotated[str, ROADS] = "highway", method: str = "map") -> None:
    """Measure and print."""
    cycles_of(road, FIRST_SEED, method)
    found = [cycles_of(road, FIRST_SEED + k, method) for k in range(drives)]
    times, warm = (np.concatenate(part) for part in zip(*found, strict=True))
    names = "".join(f"{level:>11}%" for level in LEVELS)
    print(f"{road}, {method}: milliseconds, processor time / wall-clock time")
    print(f"cycles        number  part    {names}")
    for label, chosen in (("warm", times[warm]), ("all", times)):
        for part, own in (("estimate", chosen[:, 0]), ("plan", chosen[:, 1])):
            print(f"{label:12} {len(own):7}  {part:8}{percentiles(own)}")
        print(f"{label:12} {len(chosen):7}  {'both':8}{percentiles(chosen.sum(axis=1))}")


def percentiles(times: np.ndarray) -> str:
    """Percentiles of times (C, 2) [s] as text."""
    found = np.percentile(1e3 * times, LEVELS, axis=0)
    return "".join(f"{f'{cpu:.1f}/{wall:.1f}':>12}" for cpu, wall in found)


def cycles_of(road: str, seed: int, method: str) -> tuple[np.ndarray, np.ndarray]:
    """Times (C, 2, 2) of estimate and plan [s], and whether cycles (C,) were warm."""
    try:
        world = DriveWorld(road, seed)
    except NoDriveError:
        return np.zeros((0, 2, 2)), np.zeros(0, dtype=bool)
    player, planner, rng = Here(), GamePlanner(), np.random.default_rng(seed)
    beliefs = beliefs_here(player, road, method)
    times, warm = [], []
    former: tuple[int, ...] = ()
    while not world.over:
        cars, samples = seen(world, RULES.sigma, lambda _: rng)
        player.began = False
        ticks = [clock()]
        beliefs.see(cars, samples)
        ticks.append(clock())
        plan = planner.plan(beliefs.minds(cars), samples)
        ticks.append(clock())
        if len(cars) == CARS:
            times.append(np.diff(ticks, axis=0))
            warm.append(not player.began and plan.numbers == former)
        former = plan.numbers
        world.advance(plan.control)
    return np.array(times).reshape(-1, 2, 2), np.array(warm, dtype=bool)


def clock() -> np.ndarray:
    """Processor time and wall-clock time [s]."""
    return np.array([time.process_time(), time.perf_counter()])


if __name__ == "__main__":
    shared.command(main)
