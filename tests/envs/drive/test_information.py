import numpy as np
import pytest

from olne_bench.envs.drive import information
from olne_bench.envs.drive.cars import Car
from olne_bench.envs.drive.ego_seen import AverageEgo
from olne_bench.envs.drive.information import value_of_information
from tests.envs.drive.conftest import MERGE, true_minds

Meeting = tuple[tuple[Car, ...], np.ndarray]


def value(cars: tuple[Car, ...]) -> float:
    rng = np.random.default_rng(0)
    return value_of_information(cars, MERGE, AverageEgo(MERGE), "temperaments", rng)


def test_to_know_what_one_knows_anyway_is_worth_nothing(
    meeting: Meeting, monkeypatch: pytest.MonkeyPatch
) -> None:
    cars, _ = meeting
    monkeypatch.setattr(information, "_plausible", lambda cars, *_: true_minds(cars))
    assert value(cars) == pytest.approx(0.0, abs=1e-9)


def test_it_is_a_loss_and_the_same_each_time(meeting: Meeting) -> None:
    cars, _ = meeting
    assert value(cars) >= 0
    assert value(cars) == value(cars)
