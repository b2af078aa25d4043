"""What knowing the others is worth to an ego, before it meets them.

An ego that takes the others for something plausible, and never learns better, pays more than one
that knows them. The mean of that, over what is plausible, is the value of information. For a whole
encounter it is found by driving it (``value_of_information``); for its first plan alone, which is
quick, the ego follows that plan for 4 s (``loss_of_first_plan``). Costs are those of ``EgoCost``:
shares of what it costs to stand, and one for each step after a collision.
"""

from collections.abc import Sequence

import numpy as np

from olne_bench.envs.drive.cars import (
    MOTION,
    STEP,
    Car,
    DriveRoad,
    EgoCost,
    Mind,
    drawn_weights,
    least_gaps,
)
from olne_bench.envs.drive.ego_seen import EgoSeen
from olne_bench.envs.drive.nash_traffic import REPLAN, NashTraffic
from olne_bench.envs.drive.others import Others
from olne_bench.envs.drive.responding import RespondingPlanner
from olne_bench.envs.drive.response import LEAST_GAP
from olne_bench.envs.roads.road_scenario import with_target
from olne_bench.games.model.dynamics import rollout

#: Sets of weights and target speeds of the others that an ego might believe in.
PLAUSIBLE = 5


def plausible_minds(
    cars: Sequence[Car], road: DriveRoad, kind: str, rng: np.random.Generator
) -> list[list[Mind]]:
    """The true minds, and plausible ones: weights of this ``kind`` and the road's speeds."""
    truth = [Mind(car.number, car.player, car.weights) for car in cars]
    found = [truth]
    for _ in range(PLAUSIBLE):
        others = [
            Mind(
                car.number,
                with_target(car.player, rng.uniform(*road.family.speeds)),
                drawn_weights(rng, kind),
            )
            for car in cars[1:]
        ]
        found.append([truth[0], *others])
    return found


def loss_of_first_plan(
    cars: Sequence[Car], road: DriveRoad, seen: EgoSeen, guesses: Sequence[Sequence[Mind]]
) -> float | None:
    """Mean cost of first plans for other guesses than the first, the truth, less the least.

    The ego is the first car, which the others take for what is seen. None if even the plan for the
    truth comes nearer than the least gap.
    """
    states = np.stack([car.start for car in cars])
    plans = [RespondingPlanner(road, cars[0], seen).plan(one, states) for one in guesses]
    own = np.stack([plan.controls[:, 0] for plan in plans])
    others = Others(road, cars[0], seen, guesses[:1])
    motion, controls = others.played(others.first_planned(states), own, REPLAN)
    if least_gaps(motion[0, 0]).min() < LEAST_GAP:
        return None
    costs = EgoCost(cars[0]).of_plans(motion[0], controls[0, :, :, 0])
    return float(costs[1:].mean() - costs.min())


def value_of_information(
    cars: Sequence[Car],
    plan: tuple[np.ndarray, np.ndarray],
    road: DriveRoad,
    seen: EgoSeen,
    guesses: Sequence[Sequence[Mind]],
    steps: int,
) -> float:
    """Mean cost of drives by other guesses than the first, the truth, less that of this one.

    The others begin with their plan: states (T, N, 4) and controls (T-1, N, 2).
    """
    costs = [_cost_of_drive(cars, plan, road, seen, minds, steps) for minds in guesses]
    return float(np.mean(costs[1:]) - costs[0])


def _cost_of_drive(
    cars: Sequence[Car],
    plan: tuple[np.ndarray, np.ndarray],
    road: DriveRoad,
    seen: EgoSeen,
    minds: Sequence[Mind],
    steps: int,
) -> float:
    """What the ego pays for so many steps if it believes in these minds."""
    traffic, planner = NashTraffic(plan, seen), RespondingPlanner(road, cars[0], seen)
    motion, controls = [np.stack([car.start for car in cars])], []
    for step in range(steps):
        states = motion[-1]
        if step % REPLAN == 0:
            traffic.plan(cars, states)
        others = [traffic.control(*one) for one in zip(cars[1:], states[1:], strict=True)]
        controls.append(np.stack([planner.plan(minds, states).control, *others]))
        motion.append(rollout(MOTION, states, controls[-1][None], STEP)[1])
    own = np.stack(controls)[:, 0]
    return float(EgoCost(cars[0]).of_plans(np.stack(motion), own))
