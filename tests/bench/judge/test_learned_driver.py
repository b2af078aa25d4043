"""The planner ``ppo``: a network that was trained in drives."""

import numpy as np

from olne_bench.bench.judge.learned_driver import LearnedDriver
from olne_bench.envs.drive.ego_env import ACCELERATION
from olne_bench.envs.drive.setting import STOCK, DriveSetting
from olne_bench.envs.drive.world import DriveWorld
from olne_bench.envs.roads.highway_roads import MAX_ACCELERATION, MAX_STEERING

#: Training drew its seeds below ``ego_env.FIRST_SEED + 10**8``.
SEED = 200_000_000


def test_what_it_does_is_within_what_a_car_can_do() -> None:
    world = DriveWorld(DriveSetting("highway", STOCK), SEED)
    driver, rng = LearnedDriver(world.cars[0]), np.random.default_rng(0)
    for _ in range(20):
        samples = world.states() + rng.normal(0, 5, world.states().shape)
        steering, acceleration = driver.control(samples)
        assert abs(steering) <= MAX_STEERING
        assert abs(acceleration) <= min(ACCELERATION, MAX_ACCELERATION)


def test_it_sees_the_others() -> None:
    world = DriveWorld(DriveSetting("highway", STOCK), SEED)
    ego, *_ = samples = world.states()
    driver = LearnedDriver(world.cars[0])
    near = np.stack([ego, ego + np.array([8.0, 0.0, 0.0, -10.0])])
    assert len(samples) > 1 and driver.control(near)[1] < driver.control(near[:1])[1]
