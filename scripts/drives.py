"""An ego that estimates and plans among Nash traffic: how long it takes.

    python scripts/drives.py [--drives 10] [--road highway] [--method map]

Drives are those of the suite ``driving``, with Nash traffic, its window and its noise of 0.1 m, on
one core and in one process.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import shared
import numpy as np

from olne_bench.bench.judge.beliefs import EstimatedBeliefs, EstimateRules
from olne_bench.bench.judge.players import Answer, PlayerTask
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.run.player import prepare, told, update
from olne_bench.envs.drive.cars import ROADS, STEP
from olne_bench.envs.drive.planner import EgoPlan, GamePlanner
from olne_bench.envs.drive.setting import DriveSetting
from olne_bench.envs.drive.starts import NoDriveError
from olne_bench.envs.drive.world import DriveWorld, seen
from olne_bench.estimators.protocol import Problem

SUITE = load_suite("driving")
RULES = EstimateRules(SUITE.rules.window, SUITE.sigmas[0], SUITE.rules.deadline or STEP)
CARS = 5
LEVELS = (50, 95, 99)
FIRST_SEED = 20_000_000  # of drives that compile what is needed; the next ones count


@dataclass
class Here:
    """Runs an estimator in this process; ``began`` says whether a stream began since last asked."""

    began: bool = False

    def start(self, task: PlayerTask) -> str | None:
        """As of ``judge.players.StreamPlayer``."""
        self.began = True
        return prepare(*told(task)).declined

    def update(self, sample: np.ndarray) -> Answer:
        """As of ``judge.players.StreamPlayer``. It takes no time: no estimate is late."""
        return Answer(estimate=update(sample.copy(), 2 * RULES.deadline).estimate, seconds=0.0)


@dataclass
class Cycle:
    """What the ego did in one step; ``ticks`` are clocks before, between, and after both parts."""

    plan: EgoPlan
    began: bool
    ticks: np.ndarray


def cycles(world: DriveWorld, road: str, method: str, seed: int) -> Iterator[Cycle]:
    """Drive; ``method`` estimates the others."""

    def task_of(problem: Problem) -> PlayerTask:
        return PlayerTask(method, {}, "", problem, 0, SUITE.time_limit, lag=RULES.window)

    player, planner, rng = Here(), GamePlanner(), np.random.default_rng(seed)
    beliefs = EstimatedBeliefs(player, task_of, ROADS[road], RULES)
    while not world.over:
        cars, samples = seen(world, RULES.sigma, lambda _: rng)
        player.began = False
        ticks = [shared.clock()]
        beliefs.see(cars, samples)
        ticks.append(shared.clock())
        plan = planner.plan(beliefs.minds(cars), samples)
        ticks.append(shared.clock())
        yield Cycle(plan, player.began, np.array(ticks))
        world.advance(plan.control)


def latency(drives: int = 10, road: Annotated[str, ROADS] = "highway", method: str = "map") -> None:
    """How long an ego takes for a cycle of a drive: an estimate of the others, and a plan.

    Counts cycles with five cars, the ego and four others. A cycle is warm if its stream and its
    former plan are about the same cars and the stream goes on; a stream that begins updates with
    each sample of its window. Prints the median and the 95 % and 99 % percentiles [ms] of warm and
    of all cycles: of the estimate, of the plan, and of both, in processor time and wall-clock time.
    """
    times_of(road, FIRST_SEED, method)
    found = [times_of(road, FIRST_SEED + k, method) for k in range(drives)]
    times, warm = (np.concatenate(part) for part in zip(*found, strict=True))
    print(f"{road}, {method}: milliseconds, processor time / wall-clock time")
    rows = []
    for label, chosen in (("warm", times[warm]), ("all", times)):
        parts = {"estimate": chosen[:, 0], "plan": chosen[:, 1], "both": chosen.sum(axis=1)}
        for part, own in parts.items():
            levels = np.percentile(1e3 * own, LEVELS, axis=0)
            shown = [f"{cpu:.1f}/{wall:.1f}" for cpu, wall in levels]
            row = {"cycles": label, "number": len(own), "part": part}
            rows.append(row | dict(zip((f"{n}%" for n in LEVELS), shown, strict=True)))
    shared.show(rows)


def times_of(road: str, seed: int, method: str) -> tuple[np.ndarray, np.ndarray]:
    """Times (C, 2, 2) of estimate and plan [s], and whether cycles (C,) were warm."""
    try:
        world = DriveWorld(DriveSetting(road), seed)
    except NoDriveError:
        return np.zeros((0, 2, 2)), np.zeros(0, dtype=bool)
    times, warm = [], []
    former: tuple[int, ...] = ()
    for one in cycles(world, road, method, seed):
        if len(one.plan.numbers) == CARS:
            times.append(np.diff(one.ticks, axis=0))
            warm.append(not one.began and one.plan.numbers == former)
        former = one.plan.numbers
    return np.array(times).reshape(-1, 2, 2), np.array(warm, dtype=bool)


if __name__ == "__main__":
    shared.command(latency)
