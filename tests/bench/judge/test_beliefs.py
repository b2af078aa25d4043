"""What an ego takes others to be, with a player whose answers and times are made up."""

import numpy as np
import pytest

from olne_bench.bench.judge.beliefs import (
    SAMPLES,
    EstimatedBeliefs,
    EstimateRules,
    PopulationBeliefs,
    UniformBeliefs,
)
from olne_bench.bench.judge.players import Answer, PlayerFault, PlayerTask
from olne_bench.bench.judge.raw_estimate import read_estimate
from olne_bench.envs.drive.cars import ROADS, Car, Mind, middle_speed, prior_of, proposed_cars
from olne_bench.envs.drive.nash_traffic import HORIZON
from olne_bench.estimators.protocol import Estimate, Problem
from olne_bench.games.model.unknowns import Unknown
from olne_bench.games.model.weight_prior import FLAT

ROAD = ROADS["highway"]
UNIFORM = np.full(4, 0.25)
RULES = EstimateRules(window=3, sigma=0.1, deadline=0.2)


class Player:
    """Its k-th estimate gives the first weight 0.1 k, and target speeds of 20 + k m/s."""

    def __init__(self, seconds: float = 0.0, fails_at: int = 0) -> None:
        self.seconds, self.fails_at, self.answers = seconds, fails_at, 0
        self.tasks: list[PlayerTask] = []
        self.samples: list[list[np.ndarray]] = []

    def start(self, task: PlayerTask) -> str | None:
        self.tasks.append(task)
        self.samples.append([])
        return None

    def update(self, sample: np.ndarray) -> Answer:
        self.samples[-1].append(sample)
        self.answers += 1
        if self.answers == self.fails_at:
            raise PlayerFault("crash", "it fell over")
        players = len(sample)
        weights = np.full((players, 4), (1 - 0.1 * self.answers) / 3)
        weights[:, 0] = 0.1 * self.answers
        speeds = np.full((players, 1), 20.0 + self.answers)
        estimate = Estimate(weights=weights, parameters=speeds)
        return Answer(estimate=read_estimate(estimate), seconds=self.seconds)


def task_of(problem: Problem) -> PlayerTask:
    return PlayerTask("made up", {}, "", problem, 0, 10.0, lag=3)


@pytest.fixture
def cars() -> list[Car]:
    return proposed_cars(ROAD, np.random.default_rng(0), "temperaments")


def beliefs_of(player: Player) -> EstimatedBeliefs:
    return EstimatedBeliefs(player, task_of, ROAD, RULES)


def sample(cars: list[Car], step: int) -> np.ndarray:
    return np.stack([car.start for car in cars]) + step


def test_uniform_until_there_is_an_estimate(cars: list[Car]) -> None:
    beliefs = beliefs_of(Player())
    for beliefs_now in (beliefs, UniformBeliefs(ROAD)):
        ego, *others = beliefs_now.minds(cars)
        assert ego.weights is cars[0].weights and ego.player == cars[0].player
        assert all(np.array_equal(mind.weights, UNIFORM) for mind in others)
        speeds = {mind.player.preferences[1].target for mind in others}  # type: ignore[attr-defined]
        assert speeds == {middle_speed(ROAD)}
    beliefs.see(cars, sample(cars, 0))
    assert beliefs.minds(cars)[1].weights[0] == pytest.approx(0.1)
    assert beliefs.minds(cars)[1].player.preferences[1].target == 21  # type: ignore[attr-defined]


def test_a_late_estimate_counts_at_the_next_sample(cars: list[Car]) -> None:
    beliefs = beliefs_of(Player(seconds=0.3))
    beliefs.see(cars, sample(cars, 0))
    assert beliefs.minds(cars)[1].weights[0] == 0.25
    beliefs.see(cars, sample(cars, 1))
    assert beliefs.minds(cars)[1].weights[0] == pytest.approx(0.1)
    assert (beliefs.late, beliefs.updates) == (2, 2)
    assert beliefs.beyond == pytest.approx(0.1)  # [s] that the ego does not wait


def test_other_cars_make_another_stream_of_the_samples_that_show_them(cars: list[Car]) -> None:
    player = Player()
    beliefs = beliefs_of(player)
    for step, present in enumerate((cars, cars, cars[:-1], cars[:-1])):
        beliefs.see(present, sample(present, step))
    assert [len(task.problem.game.players) for task in player.tasks] == [5, 4]
    assert [len(samples) for samples in player.samples] == [2, 4]
    assert np.array_equal(player.samples[1][0], sample(cars[:-1], 0))
    beliefs.see(cars, sample(cars, 4))  # the last one is back, and was not seen in between
    assert [len(samples) for samples in player.samples] == [2, 4, 1]


def test_a_stream_goes_on_while_its_cars_stay(cars: list[Car]) -> None:
    player = Player()
    beliefs = beliefs_of(player)
    for step in range(2 * HORIZON):
        player.answers = 0  # its weights stay valid
        beliefs.see(cars, sample(cars, step))
    assert [len(samples) for samples in player.samples] == [2 * HORIZON]
    assert player.tasks[0].problem.goes_on
    assert player.tasks[0].problem.game.horizon == HORIZON


def test_a_stream_that_is_ready_begins_with_the_first_sample(cars: list[Car]) -> None:
    player, alone = Player(), Player()
    beliefs = beliefs_of(player)
    beliefs.ready(cars)
    assert len(player.tasks) == 1 and not player.samples[0]
    for step in range(2):
        beliefs.see(cars, sample(cars, step))
    assert [len(samples) for samples in player.samples] == [2]
    beliefs_of(alone).ready(cars[:1])
    assert not alone.tasks


class Unwilling(Player):
    """Declines every problem."""

    def start(self, task: PlayerTask) -> str | None:
        return "not this one"


def test_who_declines_is_not_asked_again(cars: list[Car]) -> None:
    beliefs = beliefs_of(Unwilling())
    beliefs.ready(cars)
    beliefs.see(cars, sample(cars, 0))
    assert beliefs.fault is not None and beliefs.fault.status == "skipped"
    assert (beliefs.updates, beliefs.failed) == (0, 1)
    assert beliefs.minds(cars)[1].weights[0] == 0.25


def test_what_more_samples_have_said_counts_for_some_steps(cars: list[Car]) -> None:
    player = Player()
    beliefs = beliefs_of(player)
    for step in range(4):
        beliefs.see(cars[:-1], sample(cars[:-1], step))
    newcomer = cars[-1]
    told = []  # the first weights of a car that was known, and of the newcomer
    for step in range(4, 7):
        player.answers = step
        beliefs.see(cars, sample(cars, step))
        told.append([float(mind.weights[0]) for mind in beliefs.minds(cars)[1:]])
    assert told[0][0] == pytest.approx(0.4)  # of three samples, not of the first one with all cars
    assert beliefs.minds(cars)[-1].number == newcomer.number
    assert [known for *_, known in told] == pytest.approx([0.5, 0.6, 0.7])
    assert [known for known, *_ in told] == pytest.approx([0.4, 0.6, 0.7])  # two, and two are left


def test_a_problem_says_nothing_that_is_hidden(cars: list[Car]) -> None:
    player = Player()
    beliefs_of(player).see(cars, sample(cars, 0))
    ego, *others = player.tasks[0].problem.game.players
    assert ego == cars[0].player
    assert all(isinstance(other.preferences[1].target, Unknown) for other in others)  # type: ignore[attr-defined]


def test_after_a_fault_the_last_estimate_counts(cars: list[Car]) -> None:
    beliefs = beliefs_of(Player(fails_at=2))
    for step in range(4):
        beliefs.see(cars, sample(cars, step))
    assert beliefs.fault is not None and beliefs.fault.status == "crash"
    assert beliefs.minds(cars)[1].weights[0] == pytest.approx(0.1)
    assert (beliefs.updates, beliefs.failed) == (2, 1)


def speed_of(mind: Mind) -> float:
    return float(mind.player.preferences[1].target)  # type: ignore[attr-defined]


def test_samples_of_the_population_are_drivers_of_the_road(cars: list[Car]) -> None:
    prior = prior_of("temperaments")
    beliefs = PopulationBeliefs(ROAD, prior)
    samples = beliefs.samples(cars)
    assert len(samples) == SAMPLES
    low, high = ROAD.family.speeds
    for minds in samples:
        assert minds[0].weights is cars[0].weights
        assert all(low <= speed_of(mind) <= high for mind in minds[1:])
        assert all(mind.weights.sum() == pytest.approx(1.0) for mind in minds)
    assert len({speed_of(minds[1]) for minds in samples}) == SAMPLES
    again = beliefs.samples(cars)
    np.testing.assert_array_equal(samples[3][2].weights, again[3][2].weights)
    np.testing.assert_allclose(beliefs.minds(cars)[1].weights, prior.mean(4))


class SurePlayer(Player):
    """Says how sure it is."""

    def update(self, sample: np.ndarray) -> Answer:
        players = len(sample)
        centred = np.eye(4) - 0.25
        shape = centred @ np.diag([0.0004, 0.0001, 0.0001, 0.0001]) @ centred
        estimate = Estimate(
            weights=np.full((players, 4), 0.25),
            parameters=np.full((players, 1), 22.0),
            covariance=np.kron(np.eye(players), shape),
            parameter_deviations=np.full((players, 1), 0.5),
        )
        return Answer(estimate=read_estimate(estimate), seconds=0.0)


def test_samples_are_spread_as_the_estimate_says(cars: list[Car]) -> None:
    beliefs = beliefs_of(SurePlayer())
    beliefs.see(cars, sample(cars, 0))
    drawn = beliefs.samples(cars)
    weights = np.array([[mind.weights for mind in minds[1:]] for minds in drawn])
    speeds = np.array([[speed_of(mind) for mind in minds[1:]] for minds in drawn])
    assert np.abs(weights - 0.25).max() < 0.1
    assert 0.2 < speeds.std() < 0.9
    np.testing.assert_allclose(weights.sum(axis=-1), 1.0)
    beliefs.see(cars, sample(cars, 1))
    np.testing.assert_array_equal(speeds[0, 0], speed_of(beliefs.samples(cars)[0][1]))


def test_an_estimate_that_does_not_say_how_sure_it_is_leaves_the_population(
    cars: list[Car],
) -> None:
    beliefs = beliefs_of(Player())
    beliefs.see(cars, sample(cars, 0))
    before = PopulationBeliefs(ROAD, FLAT).samples(cars)
    np.testing.assert_array_equal(beliefs.samples(cars)[2][1].weights, before[2][1].weights)
