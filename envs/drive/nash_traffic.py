"""Cars that plan again each second: an open-loop Nash equilibrium with the ego as a player.

What they take the ego for is said by ``envs.drive.ego_seen``.

Costs are finite, so some equilibria lead cars into each other. Then the variational equilibrium in
which all of them keep a distance is taken. A plan that is not found, not certified, or leads into
another car all the same is not driven: the car follows the rest of its former plan, and when that
is used up it brakes.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from olne_bench.envs.drive.cars import FIRST_STEP, STEP, Car, drive_game
from olne_bench.envs.drive.ego_seen import EgoSeen
from olne_bench.envs.roads.footprint import CarsApart, gaps
from olne_bench.envs.roads.highway_roads import MAX_ACCELERATION, MAX_STEERING
from olne_bench.games.model.game import Game
from olne_bench.games.solve.best_response import grown_plans
from olne_bench.games.solve.constrained import variational_solution
from olne_bench.games.solve.continuation import coupled_features
from olne_bench.games.solve.newton import unpack
from olne_bench.games.solve.olne import solve_olne

#: States of a plan: 4 s.
HORIZON = round(4.0 / STEP) + 1
#: Steps from one plan to the next: 1 s.
REPLAN = round(1.0 / STEP)
_BRAKING = 6.0  # [m/s^2]
_ROUNDS = 30  # of best responses, in an attempt at an equilibrium
_ATTEMPTS = 1  # at a variational equilibrium, from each start


@dataclass
class PlanCounts:
    """What became of plans of single cars."""

    solved: int = 0  # new plans
    apart: int = 0  # those of them that a hard distance keeps out of other cars
    kept: int = 0  # rests of former plans that were followed in their place
    braked: int = 0  # cars that braked for a second, without either


class NashTraffic:
    """The plans of all cars but the ego; ``first`` are states and controls of the first plan."""

    def __init__(self, first: tuple[np.ndarray, np.ndarray] | None, ego_seen: EgoSeen) -> None:
        self.counts = PlanCounts()
        self._first, self._ego_seen = first, ego_seen
        self._plans: dict[int, np.ndarray] = {}  # controls that are left, by car number

    def plan(self, cars: Sequence[Car], states: np.ndarray) -> bool:
        """Plan again for all cars, the ego first; whether every car has a new plan."""
        own, *others = cars
        cars = [self._ego_seen.car(own, states[0]), *others]
        former = [self._plans.get(car.number) for car in cars]
        good = self._take(cars, self._first or nash_plan(cars, states, former))
        self._first = None
        if not good.all():
            apart = self._take(cars, plan_apart(cars, states, former))
            self.counts.apart += int(apart[1:].sum())
            good |= apart
        self._count(cars, good)
        return bool(good[1:].all())

    def _take(self, cars: Sequence[Car], found: tuple[np.ndarray, np.ndarray] | None) -> np.ndarray:
        """Take those plans (states and controls) that can be driven; whose they are (N,)."""
        if found is None:
            return np.zeros(len(cars), dtype=bool)
        states, controls = found
        self._ego_seen.planned(cars[0], list(cars[1:]), states, controls, REPLAN)
        good = drivable(states, controls)
        for index, car in enumerate(cars):
            if good[index]:
                self._plans[car.number] = controls[:, index]
        return good

    def control(self, car: Car, state: np.ndarray) -> np.ndarray:
        """The next control (2,) of a car, which is then used up."""
        left = self._plans.get(car.number, np.zeros((0, 2)))
        if len(left) == 0:
            return np.array([0.0, -np.clip(state[3] / STEP, -_BRAKING, _BRAKING)])
        self._plans[car.number] = left[1:]
        return np.asarray(left[0])

    def drop(self, numbers: set[int]) -> None:
        """Forget cars that are gone."""
        for number in numbers & self._plans.keys():
            del self._plans[number]

    def _count(self, cars: Sequence[Car], good: np.ndarray) -> None:
        for car, is_new in zip(cars[1:], good[1:], strict=True):
            if is_new:
                self.counts.solved += 1
            elif len(self._plans.get(car.number, ())):
                self.counts.kept += 1
            else:
                self.counts.braked += 1


def nash_plan(
    cars: Sequence[Car], states: np.ndarray, former: Sequence[np.ndarray | None]
) -> tuple[np.ndarray, np.ndarray] | None:
    """A certified equilibrium: states (T, N, 4) and controls (T-1, N, 2); None if none is found.

    Each car formerly had controls (S, 2) in mind, or None.
    """
    game = drive_game([car.player for car in cars], HORIZON)
    weights = np.stack([car.weights for car in cars])
    for controls in _starts(game, weights, states, former):
        found = solve_olne(game, weights, states, initial_controls=controls, max_rounds=_ROUNDS)
        if found.certificate.passed:
            return found.states, found.controls
    return None


def plan_apart(
    cars: Sequence[Car], states: np.ndarray, former: Sequence[np.ndarray | None]
) -> tuple[np.ndarray, np.ndarray] | None:
    """As ``nash_plan``: the variational equilibrium of cars that keep a distance; not certified."""
    pairs = combinations(range(len(cars)), 2)
    constraints = tuple(CarsApart(pair, FIRST_STEP) for pair in pairs)
    game = drive_game([car.player for car in cars], HORIZON, constraints)
    weights = np.stack([car.weights for car in cars])
    free = replace(game, constraints=())
    for controls in _starts(free, weights, states, former):
        found = variational_solution(game, weights, states, controls, most_attempts=_ATTEMPTS)
        if found.solved:
            return unpack(game, found.z)[:2]
    return None


def _starts(
    game: Game, weights: np.ndarray, states: np.ndarray, former: Sequence[np.ndarray | None]
) -> Iterator[np.ndarray]:
    """Controls (T-1, N, 2) to begin with: what the cars had in mind, and what they do alone."""
    if any(one is not None and len(one) for one in former):
        controls = np.zeros(game.control_shape)
        for index, one in enumerate(former):
            if one is not None:
                controls[: len(one), index] = one
        yield controls
    yield grown_plans(game, states, np.where(coupled_features(game), 0.0, weights))


def drivable(states: np.ndarray, controls: np.ndarray) -> np.ndarray:
    """(N,) whose plan leads into nobody and keeps within the simulator's controls."""
    touching = (gaps(states) <= 0).any(axis=(0, 2))
    within = (np.abs(controls) <= (MAX_STEERING, MAX_ACCELERATION)).all(axis=(0, 2))
    return np.asarray(within & ~touching)
