"""What knowing the others is worth to an ego at the start of a drive, before it drives.

A plan of the ego that was made for others of plausible weights and target speeds costs it more,
among the true ones with their reaction, than the best plan. The mean of that, over what is
plausible, is the value of information. Costs are those of ``EgoCost`` over the 4 s of a plan:
shares of what it costs to stand, and one for each step after a collision.
"""

from collections.abc import Sequence

import numpy as np

from olne_bench.envs.drive.cars import Car, DriveRoad, EgoCost, drawn_weights
from olne_bench.envs.drive.ego_seen import EgoSeen
from olne_bench.envs.drive.nash_traffic import REPLAN
from olne_bench.envs.drive.others import Others
from olne_bench.envs.drive.planner import Mind
from olne_bench.envs.drive.responding import RespondingPlanner
from olne_bench.envs.roads.road_scenario import with_target

#: Sets of weights and target speeds of the others that an ego might plan for.
PLAUSIBLE = 6


def value_of_information(
    cars: Sequence[Car], road: DriveRoad, seen: EgoSeen, kind: str, rng: np.random.Generator
) -> float:
    """The value, at least 0, to the ego, the first car, which the others take for what is seen.

    ``rng`` draws what is plausible: weights of this ``kind`` (``WEIGHTS``) and the road's speeds.
    """
    states = np.stack([car.start for car in cars])
    truth = [Mind(car.number, car.player, car.weights) for car in cars]
    guesses = [truth, *(_plausible(cars, road, kind, rng) for _ in range(PLAUSIBLE))]
    own = np.stack([_planned(road, cars[0], seen, minds, states) for minds in guesses])
    others = Others(road, cars[0], seen, [truth])
    motion, controls = others.played(others.first_planned(states), own, REPLAN)
    costs = EgoCost(cars[0]).of_plans(motion[0], controls[0, :, :, 0])
    return float(costs[1:].mean() - costs.min())


def _planned(
    road: DriveRoad, ego: Car, seen: EgoSeen, minds: Sequence[Mind], states: np.ndarray
) -> np.ndarray:
    """The ego's controls (T-1, 2) in its first plan."""
    planner = RespondingPlanner(road, ego, seen)
    return planner.plan(minds, states).controls[:, 0]


def _plausible(
    cars: Sequence[Car], road: DriveRoad, kind: str, rng: np.random.Generator
) -> list[Mind]:
    ego, *others = cars
    minds = [Mind(ego.number, ego.player, ego.weights)]
    for car in others:
        player = with_target(car.player, rng.uniform(*road.family.speeds))
        minds.append(Mind(car.number, player, drawn_weights(rng, kind)))
    return minds
