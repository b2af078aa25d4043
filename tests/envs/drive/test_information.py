import numpy as np
import pytest

from olne_bench.envs.drive import information
from olne_bench.envs.drive.cars import Car, Mind
from olne_bench.envs.drive.ego_seen import AverageEgo
from olne_bench.envs.drive.information import (
    PLAUSIBLE,
    loss_of_first_plan,
    plausible_minds,
    value_of_information,
)
from olne_bench.envs.drive.nash_traffic import nash_plan
from olne_bench.envs.drive.response import LEAST_GAP
from tests.envs.drive.conftest import MERGE, true_minds

Meeting = tuple[tuple[Car, ...], np.ndarray]
SEEN = AverageEgo(MERGE)


def value(meeting: Meeting, guesses: list[list[Mind]], steps: int = 6) -> float:
    cars, states = meeting
    imagined = (SEEN.car(cars[0], states[0]), *cars[1:])
    plan = nash_plan(imagined, states, [None] * len(cars))
    assert plan is not None
    return value_of_information(cars, plan, MERGE, SEEN, guesses, steps)


def guesses_at(cars: tuple[Car, ...]) -> list[list[Mind]]:
    return plausible_minds(cars, MERGE, "temperaments", np.random.default_rng(0))


def test_the_truth_is_the_first_guess_and_all_know_the_ego(meeting: Meeting) -> None:
    cars, _ = meeting
    guesses = guesses_at(cars)
    assert len(guesses) == 1 + PLAUSIBLE
    assert all(minds[0].weights is cars[0].weights for minds in guesses)
    assert [mind.weights for mind in guesses[0]] == [car.weights for car in cars]
    assert not np.array_equal(guesses[1][1].weights, cars[1].weights)


def test_to_know_what_one_knows_anyway_is_worth_nothing(meeting: Meeting) -> None:
    cars, _ = meeting
    truth = [true_minds(cars)] * 3
    assert loss_of_first_plan(cars, MERGE, SEEN, truth) == pytest.approx(0.0, abs=1e-9)
    assert value(meeting, truth) == 0.0


def test_it_is_the_same_each_time_and_a_first_plan_loses(meeting: Meeting) -> None:
    cars, _ = meeting
    guesses = guesses_at(cars)
    loss = loss_of_first_plan(cars, MERGE, SEEN, guesses)
    assert loss is not None
    assert loss >= 0
    assert value(meeting, guesses) == value(meeting, guesses)


@pytest.mark.parametrize("less", [0.01, 0.0])
def test_a_start_at_which_even_the_truth_keeps_no_room_is_none(
    meeting: Meeting, monkeypatch: pytest.MonkeyPatch, less: float
) -> None:
    cars, _ = meeting
    monkeypatch.setattr(
        information, "least_gaps", lambda one: np.full(len(one) - 1, LEAST_GAP - less)
    )
    loss = loss_of_first_plan(cars, MERGE, SEEN, guesses_at(cars))
    assert (loss is None) == (less > 0)
