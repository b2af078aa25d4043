"""What an ego takes the others' weights and target speeds to be, while it drives among them."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from olne_bench.bench.judge.estimate_check import check_estimate
from olne_bench.bench.judge.players import PlayerFault, PlayerTask, StreamPlayer
from olne_bench.bench.judge.raw_estimate import InvalidEstimateError
from olne_bench.envs.drive.cars import Car, DriveRoad, drive_game, middle_speed
from olne_bench.envs.drive.nash_traffic import HORIZON
from olne_bench.envs.drive.planner import Mind
from olne_bench.envs.roads.road_scenario import NOISE_SCALE, unknown_speed, with_target
from olne_bench.estimators.protocol import Estimate, Problem
from olne_bench.games.model.observation import VIEWS


@dataclass(frozen=True)
class EstimateRules:
    """How an ego uses estimates."""

    window: int  # number of latest samples that count
    sigma: float  # noise on positions [m]
    deadline: float  # time [s] in which an estimate has to be there


@dataclass(frozen=True)
class _Known:
    """What an estimate says of a car."""

    weights: np.ndarray  # (4,) of its preferences
    speed: float  # target speed [m/s]
    worth: int  # number of samples that it was made from, and of those before


class Beliefs(ABC):
    """What an ego knows of the others; most learn nothing from samples."""

    def see(self, cars: Sequence[Car], samples: np.ndarray) -> None:  # noqa: B027
        """Take samples (N, 4) of cars, the ego first."""

    @abstractmethod
    def minds(self, cars: Sequence[Car]) -> list[Mind]:
        """The ego as it is, and the others as it takes them to be."""


class TrueBeliefs(Beliefs):
    """Someone has told the ego all."""

    def minds(self, cars: Sequence[Car]) -> list[Mind]:
        return [Mind(car.number, car.player, car.weights) for car in cars]


class UniformBeliefs(Beliefs):
    """Equal weights for all others, and the middle of the target speeds on the road."""

    def __init__(self, road: DriveRoad) -> None:
        self._speed = middle_speed(road)

    def minds(self, cars: Sequence[Car]) -> list[Mind]:
        ego, *others = cars
        weights = np.full_like(ego.weights, 1 / len(ego.weights))
        return [
            Mind(ego.number, ego.player, ego.weights),
            *(Mind(car.number, with_target(car.player, self._speed), weights) for car in others),
        ]


class EstimatedBeliefs(Beliefs):
    """The estimates of a stream; uniform weights and the middle speed until there are some.

    Where the cars change, another stream begins with the samples of the window at which all of its
    cars were seen. What was known of a car before counts until the new stream has more samples than
    the old knowledge is worth: its samples, less one for each step since.

    The stream's game is as long as the plans of Nash traffic: what a longer one takes for weights
    and target speeds predicts less well.
    """

    def __init__(
        self,
        player: StreamPlayer,
        task_of: Callable[[Problem], PlayerTask],
        road: DriveRoad,
        rules: EstimateRules,
    ) -> None:
        self._player, self._task_of, self._road, self._rules = player, task_of, road, rules
        self._prior = UniformBeliefs(road)
        self._known: dict[int, _Known] = {}
        self._coming: dict[int, _Known] = {}
        self._seen: list[dict[int, np.ndarray]] = []
        self._numbers: tuple[int, ...] = ()
        self._count = 0
        self._problem: Problem | None = None
        self.updates = 0  # samples at which an estimate was asked for
        self.late = 0  # those not answered in time; such an estimate counts at the next one
        self.failed = 0  # those without a valid estimate
        self.fault: PlayerFault | None = None  # why there are no further estimates

    def see(self, cars: Sequence[Car], samples: np.ndarray) -> None:
        numbers = tuple(car.number for car in cars)
        self._learn(self._coming)  # what came late counts from now on
        self._coming = {}
        self._seen.append(dict(zip(numbers, samples, strict=True)))
        del self._seen[: -self._rules.window]
        if self.fault is not None or len(cars) == 1:
            return
        self.updates += 1
        try:
            estimate, seconds = self._estimate(cars, numbers)
        except PlayerFault as fault:
            self.fault, self.failed = fault, self.failed + 1
            return
        if estimate is None:
            self.failed += 1
            return
        found = dict(zip(numbers[1:], self._said(estimate), strict=True))
        if seconds > self._rules.deadline:
            self.late, self._coming = self.late + 1, found
        else:
            self._learn(found)

    def minds(self, cars: Sequence[Car]) -> list[Mind]:
        minds = self._prior.minds(cars)
        for index, car in enumerate(cars[1:], start=1):
            if car.number in self._known:
                known = self._known[car.number]
                player = with_target(car.player, known.speed)
                minds[index] = Mind(car.number, player, known.weights)
        return minds

    def _learn(self, found: dict[int, _Known]) -> None:
        """Take what estimates say of cars, unless what is known is worth more."""
        for number, said in found.items():
            if number not in self._known or said.worth >= self._known[number].worth:
                self._known[number] = said

    def _said(self, estimate: Estimate) -> list[_Known]:
        """Of each player but the ego."""
        assert estimate.parameters is not None
        worth = self.updates + min(self._count, self._rules.window)
        return [
            _Known(weights, float(values[0]), worth)
            for weights, values in zip(estimate.weights[1:], estimate.parameters[1:], strict=True)
        ]

    def _estimate(
        self, cars: Sequence[Car], numbers: tuple[int, ...]
    ) -> tuple[Estimate | None, float]:
        """The estimate after the latest sample, if it is one, and the time [s] that it took."""
        latest = [self._seen[-1]]
        if numbers != self._numbers:
            latest = _shared(self._seen, numbers)
            self._begin(cars, numbers)
        seconds = 0.0
        for sample in latest:
            stacked = np.stack([sample[number] for number in numbers])
            answer = self._player.update(stacked)
            seconds += answer.seconds
            self._count += 1
        assert answer.estimate is not None and self._problem is not None
        try:
            estimate = check_estimate(answer.estimate, self._problem)
        except InvalidEstimateError as error:
            raise PlayerFault("invalid", str(error)) from error
        return (estimate if estimate.converged else None), seconds

    def _begin(self, cars: Sequence[Car], numbers: tuple[int, ...]) -> None:
        """Begin a stream about these cars."""
        ego, *others = cars
        speed = unknown_speed(self._road.family.speeds)
        players = [ego.player, *(with_target(car.player, speed) for car in others)]
        self._problem = Problem(
            drive_game(players, max(HORIZON, self._rules.window + 1)),
            VIEWS["full"],
            self._rules.sigma,
            noise_scale=NOISE_SCALE,
            goes_on=True,
        )
        self._numbers, self._count = numbers, 0
        declined = self._player.start(self._task_of(self._problem))
        if declined is not None:
            raise PlayerFault("skipped", declined)


def _shared(
    seen: list[dict[int, np.ndarray]], numbers: tuple[int, ...]
) -> list[dict[int, np.ndarray]]:
    """The latest samples at which all of these cars were seen, without a gap."""
    shared: list[dict[int, np.ndarray]] = []
    for sample in reversed(seen):
        if not all(number in sample for number in numbers):
            break
        shared.insert(0, sample)
    return shared
