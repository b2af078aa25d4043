"""How a drive begins: the first proposal of its seed that can be driven, or an encounter.

An encounter is an ego and two others, of whom one would be in its way if each drove as on an empty
road. Of the proposals of a seed, the first eight of these that can be driven are sorted by what a
first plan for other minds loses (``envs.drive.information``); the seed's number says from which
quarter of them the encounter is, so that studies have many values of information.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from olne_bench.envs.drive.cars import ROADS, Car, DriveRoad, Mind, drive_game, proposed_cars
from olne_bench.envs.drive.ego_seen import AverageEgo, EgoSeen, LearntEgo
from olne_bench.envs.drive.information import (
    loss_of_first_plan,
    plausible_minds,
    value_of_information,
)
from olne_bench.envs.drive.nash_traffic import HORIZON, drivable, nash_plan, plan_apart
from olne_bench.envs.drive.setting import AVERAGE, ENCOUNTER, KNOWN, STOCK, DriveSetting
from olne_bench.envs.roads.footprint import gap, gaps
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.solve.best_response import grown_plans
from olne_bench.games.solve.continuation import coupled_features

_MOST_PROPOSALS = 50
_START_GAP = 1.0  # least gap [m] of the ego at the start
_POOL, QUARTERS = 8, 4
#: Of an encounter: cars, proposals, by how much [m] others on roads that go on are moved along
#: their lanes, and the gap [m] below which a car is in the way.
_CARS, _MOST_ENCOUNTERS, _MOVED, _IN_THE_WAY = 3, 400, 15.0, 0.5

#: States (T, N, 4) and controls (T-1, N, 2).
Plan = tuple[np.ndarray, np.ndarray]


class NoDriveError(Exception):
    """No proposal of a seed can be driven."""


class FirstCars(NamedTuple):
    """Cars, the ego first, in Nash traffic their plan, and an encounter's value of information."""

    cars: tuple[Car, ...]
    plan: Plan | None
    value: float | None = None


class _Start(NamedTuple):
    """How an encounter might begin."""

    loss: float  # of a first plan for other minds
    cars: tuple[Car, ...]
    plan: Plan
    guesses: list[list[Mind]]


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
    for _, cars, states in _proposals(setting, seed, ROADS[setting.road], _MOST_PROPOSALS):
        if setting.traffic == STOCK:
            return FirstCars(cars, None)
        seen = ego_seen(setting).car(cars[0], states[0])
        found = nash_plan((seen, *cars[1:]), states, [None] * len(cars))
        if found is not None and drivable(*found).all():
            return FirstCars(cars, found)
    raise _no_drive(setting, seed)


def _encounter(setting: DriveSetting, seed: int) -> FirstCars:
    pool, road = [], ROADS[setting.road]
    for attempt, cars, states in _proposals(setting, seed, road, _MOST_ENCOUNTERS):
        rng = rng_of(setting.road, seed, 1, attempt)
        if (plan := _others_plan(setting, cars, states)) is None:
            continue
        seen, guesses = ego_seen(setting), plausible_minds(cars, road, setting.weights, rng)
        loss = loss_of_first_plan(cars, road, seen, guesses)
        if loss is not None:
            pool.append(_Start(loss, cars, plan, guesses))
        if len(pool) == _POOL:
            pool.sort(key=lambda one: one.loss)
            each = _POOL // QUARTERS
            chosen = int(rng_of(setting.road, seed, 2).integers(each))
            _, cars, plan, guesses = pool[seed % QUARTERS * each + chosen]
            told = cars, plan, road, ego_seen(setting), guesses, setting.steps
            return FirstCars(cars, plan, value_of_information(*told))
    raise _no_drive(setting, seed)


def _proposals(
    setting: DriveSetting, seed: int, road: DriveRoad, most: int
) -> Iterator[tuple[int, tuple[Car, ...], np.ndarray]]:
    """The first proposals whose cars are apart: number, cars, states (N, 4)."""
    for attempt in range(most):
        rng = rng_of(setting.road, seed, 0, attempt)
        if setting.scene == ENCOUNTER:
            cars = _meeting(road, rng, setting.weights)
        else:
            cars = tuple(proposed_cars(road, rng, setting.weights))
        states = np.stack([car.start for car in cars])
        near = setting.scene != ENCOUNTER or _in_the_way(cars, states)
        if gaps(states).min() >= _START_GAP and near:
            yield attempt, cars, states


def _meeting(road: DriveRoad, rng: np.random.Generator, kind: str) -> tuple[Car, ...]:
    """A proposal of few cars, which are nearer to each other than in traffic."""
    road = replace(road, cars=_CARS, lead=rng.uniform(0, road.lead))
    ego, *others = proposed_cars(road, rng, kind)
    if road.moving:
        others = [_moved(car, rng.uniform(-_MOVED, _MOVED)) for car in others]
    return ego, *others


def _moved(car: Car, along: float) -> Car:
    """The car, so far ahead [m] of where it is."""
    start = car.start.copy()
    start[:2] += along * np.array([np.cos(start[2]), np.sin(start[2])])
    return replace(car, start=start)


def _in_the_way(cars: tuple[Car, ...], states: np.ndarray) -> bool:
    """Whether the ego would meet another if each drove as on an empty road."""
    game = drive_game([car.player for car in cars], HORIZON)
    weights = np.stack([car.weights for car in cars])
    controls = grown_plans(game, states, np.where(coupled_features(game), 0.0, weights))
    motion = rollout(game.dynamics, states, controls, game.dt)
    return bool(gap(motion[:, :1], motion[:, 1:]).min() < _IN_THE_WAY)


def _others_plan(setting: DriveSetting, cars: tuple[Car, ...], states: np.ndarray) -> Plan | None:
    """What the cars plan, which take the ego for what they see in it; None if that is nothing."""
    imagined, former = (ego_seen(setting).car(cars[0], states[0]), *cars[1:]), [None] * len(cars)
    for solve in (nash_plan, plan_apart):
        found = solve(imagined, states, former)
        if found is not None and drivable(*found)[1:].all():
            return found
    return None


def _no_drive(setting: DriveSetting, seed: int) -> NoDriveError:
    most = _MOST_ENCOUNTERS if setting.scene == ENCOUNTER else _MOST_PROPOSALS
    return NoDriveError(
        f"no {setting.scene} of {setting.road!r} can be driven, of {most} proposals "
        f"from seed {seed}"
    )
