import itertools

import numpy as np
import pytest

from olne_bench.envs.drive import starts
from olne_bench.envs.drive.setting import AVERAGE, ENCOUNTER, DriveSetting
from olne_bench.envs.drive.starts import NoDriveError, first_cars
from olne_bench.envs.drive.world import DriveWorld

SETTING = DriveSetting("highway", scene=ENCOUNTER, ego=AVERAGE)


@pytest.fixture(autouse=True)
def values(monkeypatch: pytest.MonkeyPatch) -> None:
    """Losses 7, 0, 5, ... of the proposals of a seed in turn, which are their values, too."""
    first_cars.cache_clear()
    numbers = itertools.cycle([7.0, 0.0, 5.0, 2.0, 6.0, 1.0, 4.0, 3.0])
    losses: dict[int, float] = {}

    def loss(cars, *_):
        return losses.setdefault(id(cars), next(numbers))

    monkeypatch.setattr(starts, "loss_of_first_plan", loss)
    monkeypatch.setattr(starts, "value_of_information", lambda cars, *_: losses[id(cars)])


@pytest.mark.parametrize("seed", range(4))
def test_the_seed_says_from_which_quarter_an_encounter_is(seed: int) -> None:
    found = first_cars(SETTING, seed)
    assert found.value is not None
    assert found.value // 2 == seed % 4
    assert len(found.cars) == 3


def test_an_encounter_has_three_cars_that_stay_and_ends_after_eight_seconds() -> None:
    world = DriveWorld(SETTING, 1)
    assert world.value is not None
    for _ in range(40):
        assert not world.over
        assert len(world.cars) == 3
        world.advance(np.zeros(2))
        if world.crashed:
            return
    assert world.over


def test_a_road_without_a_free_start_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(starts, "_START_GAP", 1e6)
    with pytest.raises(NoDriveError, match="no encounter of 'highway' can be driven, of 400"):
        first_cars(SETTING, 0)
