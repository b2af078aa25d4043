"""An ego that estimates and plans among Nash traffic: how long it takes, and what it can predict.

    python scripts/drives.py latency [--drives 10] [--road highway] [--method map]
    python scripts/drives.py predictions --seeds 20

Drives are those of the suite ``driving``, with Nash traffic, its window and its noise of 0.1 m, on
one core and in one process.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated

import shared
import numpy as np

from olne_bench.bench.judge.beliefs import EstimatedBeliefs, EstimateRules, TrueBeliefs
from olne_bench.bench.judge.players import Answer, PlayerTask
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.run.player import prepare, told, update
from olne_bench.envs.drive.cars import MOTION, ROADS, STEP, drive_game
from olne_bench.envs.drive.nash_traffic import REPLAN
from olne_bench.envs.drive.planner import EgoPlan, GamePlanner, Mind
from olne_bench.envs.drive.setting import DriveSetting
from olne_bench.envs.drive.starts import NoDriveError
from olne_bench.envs.drive.world import DriveWorld, seen
from olne_bench.estimators.protocol import Problem
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.solve.newton import newton_root
from olne_bench.games.solve.olne import RESIDUAL_TOLERANCE

SUITE = load_suite("driving")
RULES = EstimateRules(SUITE.rules.window, SUITE.sigmas[0], SUITE.rules.deadline or STEP)
CARS = 5
LEVELS = (50, 95, 99)
FIRST_SEED = 20_000_000  # of drives that compile what is needed; the next ones count
AHEAD = 3 * REPLAN  # 3 s
KINDS = ("straight on", "one equilibrium", "planned again")


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

    minds: list[Mind]
    samples: np.ndarray
    plan: EgoPlan
    began: bool
    ticks: np.ndarray


def cycles(world: DriveWorld, road: str, method: str, seed: int) -> Iterator[Cycle]:
    """Drive; ``method`` estimates the others, or is ``truth``, which knows all without noise."""

    def task_of(problem: Problem) -> PlayerTask:
        return PlayerTask(method, {}, "", problem, 0, SUITE.time_limit, lag=RULES.window)

    player, planner, rng = Here(), GamePlanner(), np.random.default_rng(seed)
    exact = method == "truth"
    own = EstimatedBeliefs(player, task_of, ROADS[road], RULES)
    beliefs = TrueBeliefs() if exact else own
    while not world.over:
        cars, samples = seen(world, 0.0 if exact else RULES.sigma, lambda _: rng)
        player.began = False
        ticks = [shared.clock()]
        beliefs.see(cars, samples)
        ticks.append(shared.clock())
        minds = beliefs.minds(cars)
        plan = planner.plan(minds, samples)
        ticks.append(shared.clock())
        yield Cycle(list(minds), samples, plan, player.began, np.array(ticks))
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
        if len(one.samples) == CARS:
            times.append(np.diff(one.ticks, axis=0))
            warm.append(not one.began and one.plan.numbers == former)
        former = one.plan.numbers
    return np.array(times).reshape(-1, 2, 2), np.array(warm, dtype=bool)


def predictions(
    seeds: int = 20, roads: tuple[Annotated[str, list(ROADS)], ...] = tuple(ROADS)
) -> None:
    """What predictions among Nash traffic can reach, by what the ego knows of the others.

    At each step the ego predicts the others in three ways: straight on, as one equilibrium over
    4 s, and as players who plan again each second, as they do. ``truth`` knows weights, target
    speeds and states; what is left of its error is not for want of knowledge: the ego drives
    otherwise than the others expect. ``map`` estimates them from noisy samples. Each of them
    drives. Prints a line for each road.
    """
    print("position error of others 3 s ahead [m]: median over drives of each drive's mean")

    def rows() -> Iterator[dict[str, object]]:
        for road in roads:
            for known in ("truth", "map"):
                drives = (errors_of(road, seed, known) for seed in range(seeds))
                found = [errors for errors in drives if errors]
                shown = [f"{value:.2f}" for value in np.median(found, axis=0)]
                row: dict[str, object] = {"road": road, "known": known, "drives": len(found)}
                yield row | dict(zip(KINDS, shown, strict=True))

    shared.show(rows())


def errors_of(road: str, seed: int, known: str) -> list[float]:
    """Mean error [m] of each kind of prediction in one drive; empty if there is none."""
    try:
        world = DriveWorld(DriveSetting(road), seed)
    except NoDriveError:
        return []
    motion, predicted = [], []
    for one in cycles(world, road, known, seed):
        motion.append(dict(zip((car.number for car in world.cars), world.states(), strict=True)))
        predicted.append((one.plan.numbers, predictions_of(one, world.step)))
    errors: list[list[float]] = [[] for _ in KINDS]
    for (numbers, kinds), later in zip(predicted, motion[AHEAD:], strict=False):
        for own, places in zip(errors, kinds, strict=True):
            for number, place in list(zip(numbers, places, strict=True))[1:]:
                if number in later:
                    own.append(float(np.linalg.norm(place - later[number][:2])))
    return [float(np.mean(own)) for own in errors]


def predictions_of(one: Cycle, step: int) -> list[np.ndarray]:
    """Positions (N, 2) in 3 s, in each of the ``KINDS``; a shorter plan's end stands for it."""
    states, planned = one.samples, one.plan.states
    heading, speed = states[:, 2], states[:, 3]
    way = AHEAD * STEP * speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    together = planned[min(AHEAD, len(planned) - 1), :, :2]
    return [states[:, :2] + way, together, planned_again(one.minds, states, one.plan, step)]


def planned_again(
    minds: Sequence[Mind], states: np.ndarray, plan: EgoPlan, step: int
) -> np.ndarray:
    """Positions (N, 2) in 3 s if all follow the plan up to the next second, and plan again then.

    Where no equilibrium is found near the former plan, they follow that one.
    """
    controls, costates, left = plan.controls, plan.costates, AHEAD
    game = drive_game([mind.player for mind in minds], len(controls) + 1)
    weights = np.stack([mind.weights for mind in minds])
    steps = REPLAN - step % REPLAN
    while True:
        steps = min(steps, left, len(controls))
        states = rollout(MOTION, states, controls[:steps], STEP)[-1]
        left -= steps
        if not left:
            return np.asarray(states[:, :2])
        controls, costates = (shifted(values, steps) for values in (controls, costates))
        near = rollout(MOTION, states, controls, STEP)
        root = newton_root(game, near, controls, costates, weights)
        if root.residual < RESIDUAL_TOLERANCE:
            controls, costates = root.controls, root.costates
        steps = REPLAN


def shifted(values: np.ndarray, steps: int) -> np.ndarray:
    """Values (T-1, ...) of a plan without its first steps, the last one repeated."""
    return np.concatenate([values[steps:], np.repeat(values[-1:], steps, axis=0)])


if __name__ == "__main__":
    shared.command(latency, predictions)
