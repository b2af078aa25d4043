"""With which cars a drive begins: the first proposal of its seed that can be driven."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from olne_bench.envs.drive.cars import ROADS, Car, proposed_cars
from olne_bench.envs.drive.gaps import gaps
from olne_bench.envs.drive.nash_traffic import drivable, nash_plan

#: Traffic: players of the family's game, and HighwayEnv's own drivers (IDM and MOBIL).
NASH, STOCK = "nash", "stock"
TRAFFIC = (NASH, STOCK)

_MOST_PROPOSALS = 50
_START_GAP = 1.0  # least gap [m] of the ego at the start


class NoDriveError(Exception):
    """No proposal of a seed can be driven."""


class FirstCars(NamedTuple):
    """Cars, the ego first, and in Nash traffic the states and controls of their plan."""

    cars: tuple[Car, ...]
    plan: tuple[np.ndarray, np.ndarray] | None


@lru_cache(maxsize=4)  # the planners of a study drive a seed one after the other
def first_cars(road: str, seed: int, traffic: str, weights: str) -> FirstCars:
    """The first proposal whose cars are apart, and in Nash traffic have plans.

    Raises:
        NoDriveError: if no proposal of the seed can be driven.
    """
    for attempt in range(_MOST_PROPOSALS):
        cars = tuple(proposed_cars(ROADS[road], rng_of(road, seed, 0, attempt), weights))
        states = np.stack([car.start for car in cars])
        if gaps(states).min() < _START_GAP:
            continue
        if traffic == STOCK:
            return FirstCars(cars, None)
        found = nash_plan(cars, states, [None] * len(cars))
        if found is not None and drivable(*found).all():
            return FirstCars(cars, found)
    raise NoDriveError(
        f"no proposal of {road!r} can be driven, of {_MOST_PROPOSALS} from seed {seed}"
    )


def rng_of(road: str, seed: int, *key: int) -> np.random.Generator:
    """Random numbers of a drive; the key says what for."""
    return np.random.default_rng([seed, list(ROADS).index(road), *key])
