"""What predictions among Nash traffic can reach, by what the ego knows of the others.

At each step the ego predicts the others in three ways: straight on, as one equilibrium over 4 s,
and as players who plan again each second, as they do. ``truth`` knows weights, target speeds and
states; what is left of its error is not for want of knowledge: the ego drives otherwise than the
others expect. ``map`` estimates them from samples with noise of 0.1 m. Each of them drives.

Usage: python scripts/drive_predictions.py --seeds 20
"""

from collections.abc import Sequence
from typing import Annotated

import shared
import numpy as np
from beliefs_here import RULES, Here, beliefs_here

from olne_bench.bench.judge.beliefs import TrueBeliefs
from olne_bench.envs.drive.cars import MOTION, ROADS, STEP, drive_game
from olne_bench.envs.drive.nash_traffic import REPLAN
from olne_bench.envs.drive.planner import EgoPlan, GamePlanner, Mind
from olne_bench.envs.drive.world import DriveWorld, NoDriveError, seen
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.solve.newton import newton_root
from olne_bench.games.solve.olne import RESIDUAL_TOLERANCE

AHEAD = 3 * REPLAN  # 3 s
KNOWN = ("truth", "map")
KINDS = ("straight on", "one equilibrium", "planned again")


def main(seeds: int = 20, roads: tuple[Annotated[str, list(ROADS)], ...] = tuple(ROADS)) -> None:
    """Print a line for each road."""
    print("position error of others 3 s ahead [m]: median over drives of each drive's mean")
    print(f"{'road':14}{'known':7}{'drives':>7}" + "".join(f"{kind:>17}" for kind in KINDS))
    for road in roads:
        for known in KNOWN:
            drives = (errors_of(road, seed, known) for seed in range(seeds))
            found = [errors for errors in drives if errors]
            shown = "".join(f"{value:17.2f}" for value in np.median(found, axis=0))
            print(f"{road:14}{known:7}{len(found):7}{shown}", flush=True)


def errors_of(road: str, seed: int, known: str) -> list[float]:
    """Mean error [m] of each kind of prediction in one drive; empty if there is none."""
    try:
        world = DriveWorld(road, seed)
    except NoDriveError:
        return []
    exact = known == "truth"
    beliefs = TrueBeliefs() if exact else beliefs_here(Here(), road, known)
    rng = np.random.default_rng(seed)
    planner, motion, predicted = GamePlanner(), [], []
    while not world.over:
        cars, samples = seen(world, 0.0 if exact else RULES.sigma, lambda _: rng)
        motion.append(dict(zip((car.number for car in world.cars), world.states(), strict=True)))
        beliefs.see(cars, samples)
        minds = beliefs.minds(cars)
        plan = planner.plan(minds, samples)
        predicted.append((plan.numbers, predictions(minds, samples, plan, world.step)))
        world.advance(plan.control)
    errors: list[list[float]] = [[] for _ in KINDS]
    for (numbers, kinds), later in zip(predicted, motion[AHEAD:], strict=False):
        for own, places in zip(errors, kinds, strict=True):
            for number, place in list(zip(numbers, places, strict=True))[1:]:
                if number in later:
                    own.append(float(np.linalg.norm(place - later[number][:2])))
    return [float(np.mean(own)) for own in errors]


def predictions(
    minds: Sequence[Mind], states: np.ndarray, plan: EgoPlan, step: int
) -> list[np.ndarray]:
    """Positions (N, 2) in 3 s, in each of the ``KINDS``; a shorter plan's end stands for it."""
    px_py, heading, speed = states[:, :2], states[:, 2], states[:, 3]
    way = AHEAD * STEP * speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    one = plan.states[min(AHEAD, len(plan.states) - 1), :, :2]
    return [px_py + way, one, planned_again(minds, states, plan, step)]


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
    shared.command(main)
