"""How a drive begins: the first proposal of its seed that can be driven, or an encounter.

An encounter is an ego and two others. Of the proposals of a seed, eight that can be driven are
sorted by the value of information (``envs.drive.information``); the seed's number says from which
quarter of them the encounter is, so that studies have as many of each.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from olne_bench.envs.drive.cars import ROADS, Car, DriveRoad, proposed_cars
from olne_bench.envs.drive.ego_seen import AverageEgo, EgoSeen, LearntEgo
from olne_bench.envs.drive.footprint import gaps
from olne_bench.envs.drive.information import value_of_information
from olne_bench.envs.drive.nash_traffic import drivable, nash_plan, plan_apart
from olne_bench.envs.drive.setting import AVERAGE, ENCOUNTER, KNOWN, STOCK, DriveSetting

_MOST_PROPOSALS = 50
_START_GAP = 1.0  # least gap [m] of the ego at the start
_POOL, QUARTERS = 8, 4
_CARS = 3  # of an encounter

#: States (T, N, 4) and controls (T-1, N, 2).
Plan = tuple[np.ndarray, np.ndarray]


class NoDriveError(Exception):
    """No proposal of a seed can be driven."""


class FirstCars(NamedTuple):
    """Cars, the ego first, in Nash traffic their plan, and an encounter's value of information."""

    cars: tuple[Car, ...]
    plan: Plan | None
    value: float | None = None


def ego_seen(setting: DriveSetting) -> EgoSeen:
    """Who players take the ego for, at the start of a drive."""
    if setting.ego == KNOWN:
        return EgoSeen()
    return (AverageEgo if setting.ego == AVERAGE else LearntEgo)(ROADS[setting.road])


def rng_of(road: str, seed: int, *key: int) -> np.random.Generator:
    """Random numbers of a drive; the key says what for."""
    return np.random.default_rng([seed, list(ROADS).index(road), *key])


@lru_cache(maxsize=4)  # the planners of a study drive a seed one after the other
def first_cars(setting: DriveSetting, seed: int) -> FirstCars:
    """How a drive begins; NoDriveError if too few of the first proposals can be driven."""
    if setting.scene == ENCOUNTER:
        return _encounter(setting, seed)
    for _, cars, states in _proposals(setting, seed, ROADS[setting.road]):
        if setting.traffic == STOCK:
            return FirstCars(cars, None)
        seen = ego_seen(setting).car(cars[0], states[0])
        found = nash_plan((seen, *cars[1:]), states, [None] * len(cars))
        if found is not None and drivable(*found).all():
            return FirstCars(cars, found)
    raise _no_drive(setting, seed)


def _encounter(setting: DriveSetting, seed: int) -> FirstCars:
    pool, road = [], ROADS[setting.road]
    lead = rng_of(setting.road, seed, 3).uniform(0, road.lead)  # cars meet sooner than in traffic
    road = replace(road, cars=_CARS, lead=lead)
    for attempt, cars, states in _proposals(setting, seed, road):
        rng = rng_of(setting.road, seed, 1, attempt)
        if (plan := _others_plan(setting, cars, states)) is None:
            continue
        value = value_of_information(cars, road, ego_seen(setting), setting.weights, rng)
        pool.append(FirstCars(cars, plan, value))
        if len(pool) == _POOL:
            pool.sort(key=lambda one: one.value or 0.0)
            each = _POOL // QUARTERS
            chosen = rng_of(setting.road, seed, 2).integers(each)
            return pool[seed % QUARTERS * each + int(chosen)]
    raise _no_drive(setting, seed)


def _proposals(
    setting: DriveSetting, seed: int, road: DriveRoad
) -> Iterator[tuple[int, tuple[Car, ...], np.ndarray]]:
    """The first proposals whose cars are apart: number, cars, states (N, 4)."""
    for attempt in range(_MOST_PROPOSALS):
        rng = rng_of(setting.road, seed, 0, attempt)
        cars = tuple(proposed_cars(road, rng, setting.weights))
        states = np.stack([car.start for car in cars])
        if gaps(states).min() >= _START_GAP:
            yield attempt, cars, states


def _others_plan(setting: DriveSetting, cars: tuple[Car, ...], states: np.ndarray) -> Plan | None:
    """What the cars plan, which take the ego for what they see in it; None if that is nothing."""
    imagined, former = (ego_seen(setting).car(cars[0], states[0]), *cars[1:]), [None] * len(cars)
    for solve in (nash_plan, plan_apart):
        found = solve(imagined, states, former)
        if found is not None and drivable(*found)[1:].all():
            return found
    return None


def _no_drive(setting: DriveSetting, seed: int) -> NoDriveError:
    return NoDriveError(
        f"no {setting.scene} of {setting.road!r} can be driven, of {_MOST_PROPOSALS} proposals "
        f"from seed {seed}"
    )
