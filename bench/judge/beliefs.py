"""What an ego takes the others' weights and target speeds to be, while it drives among them."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from olne_bench.bench.judge.estimate_check import check_estimate
from olne_bench.bench.judge.players import PlayerFault, PlayerTask, StreamPlayer
from olne_bench.bench.judge.raw_estimate import InvalidEstimateError
from olne_bench.envs.drive.cars import Car, DriveRoad, Mind, drive_game, middle_speed
from olne_bench.envs.drive.nash_traffic import HORIZON
from olne_bench.envs.roads.road_scenario import NOISE_SCALE, unknown_speed, with_target
from olne_bench.estimators.protocol import Estimate, Problem
from olne_bench.games.model.observation import VIEWS
from olne_bench.games.model.weight_prior import FLAT, WeightPrior

#: Samples of what an ego is not sure of.
SAMPLES = 8


@dataclass(frozen=True)
class EstimateRules:
    """How an ego uses estimates."""

    window: int  # number of latest samples that count
    sigma: float  # noise on positions [m]
    deadline: float  # time [s] after which the ego plans without the estimate


@dataclass(frozen=True)
class _Known:
    """What an estimate says of a car."""

    weights: np.ndarray  # (4,) of its preferences
    speed: float  # target speed [m/s]
    samples: np.ndarray | None  # (S, 5) of both, weights first; None where it gives none
    worth: int  # number of samples that it was made from, and of those before


class Beliefs(ABC):
    """What an ego knows of the others; most learn nothing from samples."""

    beyond = 0.0  # time [s] after the deadline that the last estimate took while the ego planned

    def ready(self, cars: Sequence[Car]) -> None:  # noqa: B027
        """Prepare, before the first cycle, for the cars that are there."""

    def see(self, cars: Sequence[Car], samples: np.ndarray) -> None:  # noqa: B027
        """Take samples (N, 4) of cars, the ego first."""

    @abstractmethod
    def minds(self, cars: Sequence[Car]) -> list[Mind]:
        """The ego as it is, and the others as it takes them to be."""

    def samples(self, cars: Sequence[Car]) -> list[list[Mind]]:
        """Samples of ``minds`` where the ego is not sure; a sample differs little from before."""
        return [self.minds(cars)]


class TrueBeliefs(Beliefs):
    """Someone has told the ego all."""

    def minds(self, cars: Sequence[Car]) -> list[Mind]:
        return [Mind(car.number, car.player, car.weights) for car in cars]


class UniformBeliefs(Beliefs):
    """Equal weights for all others, and the middle of the target speeds on the road."""

    def __init__(self, road: DriveRoad) -> None:
        self._speed = middle_speed(road)

    def minds(self, cars: Sequence[Car]) -> list[Mind]:
        told = np.append(np.full_like(cars[0].weights, 1 / len(cars[0].weights)), self._speed)
        return [_ego(cars), *(_mind(car, told) for car in cars[1:])]


class PopulationBeliefs(Beliefs):
    """What drivers are like before anything is seen of one: the prior, and the road's speeds."""

    def __init__(self, road: DriveRoad, prior: WeightPrior) -> None:
        self._road, self._prior = road, prior
        self._drawn: dict[int, np.ndarray] = {}

    def minds(self, cars: Sequence[Car]) -> list[Mind]:
        mean, speed = self._prior.mean(len(cars[0].weights)), middle_speed(self._road)
        return [_ego(cars), *(_mind(car, np.append(mean, speed)) for car in cars[1:])]

    def samples(self, cars: Sequence[Car]) -> list[list[Mind]]:
        own = [self.of(car) for car in cars[1:]]
        return [
            [_ego(cars), *(_mind(car, one[k]) for car, one in zip(cars[1:], own, strict=True))]
            for k in range(SAMPLES)
        ]

    def of(self, car: Car) -> np.ndarray:
        """(S, 5) samples of the weights and the target speed of a car, always the same ones."""
        if car.number not in self._drawn:
            rng = np.random.default_rng([car.number, 0x5A])
            weights = self._prior.sample(rng, SAMPLES, len(car.weights))
            speeds = rng.uniform(*self._road.family.speeds, SAMPLES)
            self._drawn[car.number] = np.column_stack([weights, speeds])
        return self._drawn[car.number]


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
        prior: WeightPrior = FLAT,
    ) -> None:
        self._player, self._task_of, self._road, self._rules = player, task_of, road, rules
        self._before, self._population = UniformBeliefs(road), PopulationBeliefs(road, prior)
        self._prior = prior
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

    def ready(self, cars: Sequence[Car]) -> None:
        if len(cars) == 1:
            return
        try:
            self._begin(cars, tuple(car.number for car in cars))
        except PlayerFault as fault:
            self.fault, self.failed = fault, 1

    def see(self, cars: Sequence[Car], samples: np.ndarray) -> None:
        numbers = tuple(car.number for car in cars)
        self._learn(self._coming)  # what came late counts from now on
        self._coming, self.beyond = {}, 0.0
        self._seen.append(dict(zip(numbers, samples, strict=True)))
        del self._seen[: -self._rules.window]
        if self.fault is not None or len(cars) == 1:
            return
        self.updates += 1
        try:
            estimate, seconds = self._estimate(cars, numbers)
            self.beyond = max(0.0, seconds - self._rules.deadline)
        except PlayerFault as fault:
            self.fault, self.failed = fault, self.failed + 1
            return
        if estimate is None:
            self.failed += 1
            return
        found = dict(zip(numbers[1:], self._said(estimate), strict=True))
        if self.beyond:
            self.late, self._coming = self.late + 1, found
        else:
            self._learn(found)

    def minds(self, cars: Sequence[Car]) -> list[Mind]:
        minds = self._before.minds(cars)
        for index, car in enumerate(cars[1:], start=1):
            if car.number in self._known:
                known = self._known[car.number]
                minds[index] = _mind(car, np.append(known.weights, known.speed))
        return minds

    def samples(self, cars: Sequence[Car]) -> list[list[Mind]]:
        samples = self._population.samples(cars)
        for index, car in enumerate(cars[1:], start=1):
            known = self._known.get(car.number)
            if known is not None and known.samples is not None:
                for one, sample in zip(samples, known.samples, strict=True):
                    one[index] = _mind(car, sample)
        return samples

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
            _Known(weights, float(values[0]), _samples_of(estimate, player), worth)
            for player, (weights, values) in enumerate(
                zip(estimate.weights, estimate.parameters, strict=True)
            )
        ][1:]

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
            prior=self._prior,
        )
        self._numbers, self._count = numbers, 0
        declined = self._player.start(self._task_of(self._problem))
        if declined is not None:
            raise PlayerFault("skipped", declined)


def _ego(cars: Sequence[Car]) -> Mind:
    return Mind(cars[0].number, cars[0].player, cars[0].weights)


def _mind(car: Car, told: np.ndarray) -> Mind:
    """A car that is told (5,) to have these weights and this target speed."""
    return Mind(car.number, with_target(car.player, float(told[-1])), told[:-1])


def _samples_of(estimate: Estimate, player: int) -> np.ndarray | None:
    """(S, 5) samples of the weights and the target speed of a player.

    They are the estimate's own, or normal with its covariance and deviations, whose random numbers
    are the same each time, so that a sample follows the estimate.
    """
    count = estimate.weights.shape[1]
    if estimate.samples is not None and estimate.parameter_samples is not None:
        chosen = np.linspace(0, len(estimate.samples) - 1, SAMPLES).round().astype(int)
        speeds = estimate.parameter_samples[chosen, player, :1]
        return np.concatenate([estimate.samples[chosen, player], speeds], axis=1)
    if estimate.covariance is None or estimate.parameters is None:
        return None
    own = slice(player * count, (player + 1) * count)
    values, vectors = np.linalg.eigh(estimate.covariance[own, own])
    root = vectors * np.sqrt(np.maximum(values, 0)) @ vectors.T
    drawn = np.random.default_rng([player, 0x5A]).standard_normal((SAMPLES, count + 1))
    weights = estimate.weights[player] + drawn[:, :-1] @ root
    weights = np.maximum(weights, Problem.weight_floor)
    deviations = estimate.parameter_deviations
    spread = 0.0 if deviations is None else float(deviations[player, 0])
    speeds = float(estimate.parameters[player, 0]) + spread * drawn[:, -1]
    return np.column_stack([weights / weights.sum(axis=1, keepdims=True), speeds])


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
