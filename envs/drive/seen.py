"""What an ego sees of a drive: noisy samples of the nearest cars."""

from collections.abc import Callable

import numpy as np

from olne_bench.envs.drive.cars import Car
from olne_bench.envs.drive.world import DriveWorld
from olne_bench.envs.roads.road_scenario import NOISE_SCALE

#: Other cars that an ego looks at: the nearest ones.
NEAREST = 4


def seen(
    world: DriveWorld, sigma: float, rng_of: Callable[[Car], np.random.Generator]
) -> tuple[list[Car], np.ndarray]:
    """The ego and the nearest others, in order of their numbers, and samples (1 + M, 4) of them.

    The ego knows its own state.

    Args:
        world: the drive.
        sigma: standard deviation of the noise on positions [m].
        rng_of: draws the noise of a car.
    """
    samples = world.states()
    away = np.linalg.norm(samples[1:, :2] - samples[0, :2], axis=1)
    places = [0, *sorted(1 + np.argsort(away, kind="stable")[:NEAREST])]
    cars = [world.cars[place] for place in places]
    samples = samples[places]
    for sample, car in zip(samples[1:], cars[1:], strict=True):
        noise = rng_of(car).standard_normal(len(sample)) * np.array(NOISE_SCALE)
        sample += sigma * noise
    return cars, samples
