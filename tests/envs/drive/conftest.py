"""Cars that are about to meet."""

from dataclasses import replace

import numpy as np
import pytest

from olne_bench.envs.drive.cars import ROADS, Car, Mind, proposed_cars

MERGE = replace(ROADS["merge"], cars=3)


@pytest.fixture(scope="session")
def meeting() -> tuple[tuple[Car, ...], np.ndarray]:
    """An ego on a ramp and two others: cars, and their states (3, 4)."""
    cars = tuple(proposed_cars(MERGE, np.random.default_rng(5), "temperaments"))
    return cars, np.stack([car.start for car in cars])


def true_minds(cars: tuple[Car, ...]) -> list[Mind]:
    return [Mind(car.number, car.player, car.weights) for car in cars]
