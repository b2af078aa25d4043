"""Gymnasium's ids: HighwayEnv's ego among Nash traffic on five roads."""

import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from highway_env.vehicle.behavior import IDMVehicle

from olne_bench.envs.traffic import NashVehicle, traffic_report
from olne_bench.envs.worlds.gym_ids import GYM_IDS

STOCK = {
    "olne/NashHighway-v0": "highway-fast-v0",
    "olne/NashMerge-v0": "merge-v1",
    "olne/NashRoundabout-v0": "roundabout-v1",
    "olne/NashIntersection-v0": "intersection-v2",
    "olne/NashTwoWay-v0": "two-way-v0",
}
SIZES = {"olne/NashHighway-v0": {"vehicles_count": 6}}


def make(name, **arguments):
    return gymnasium.make(name, config=SIZES.get(name, {}), **arguments)


# HighwayEnv's own observation space has no bounds.
@pytest.mark.filterwarnings("ignore:.*A Box observation space")
@pytest.mark.parametrize("name", GYM_IDS)
def test_gymnasium_conformance(name):
    """The checker makes the environment again in each render mode."""
    check_env(make(name).unwrapped)


@pytest.mark.parametrize("name", GYM_IDS)
def test_everything_but_the_traffic_is_highway_envs(name):
    ours, stock = make(name), gymnasium.make(STOCK[name], config=SIZES.get(name, {}))
    assert ours.observation_space == stock.observation_space
    assert ours.action_space == stock.action_space
    differing = {
        key: value
        for key, value in ours.unwrapped.config.items()
        if stock.unwrapped.config[key] != value
    }
    assert differing.keys() == {"other_vehicles_type"}
    ours.reset(seed=1)
    stock.reset(seed=1)
    assert type(ours.unwrapped.vehicle) is type(stock.unwrapped.vehicle)
    # A step limit of the stock registration is ours as well.
    assert ours.spec.max_episode_steps == stock.spec.max_episode_steps


@pytest.mark.parametrize("name", GYM_IDS)
def test_traffic_plans_games_and_pictures_show_it(name):
    world = make(name, render_mode="rgb_array")
    world.reset(seed=0)
    world.step(world.action_space.sample())
    road = world.unwrapped.road
    traffic = [v for v in road.vehicles if v is not world.unwrapped.vehicle]
    assert traffic and all(isinstance(vehicle, NashVehicle) for vehicle in traffic)
    assert traffic_report(road).solved > 0
    assert world.render().std() > 5
    world.close()


def test_intersections_leave_other_roads_alone():
    """HighwayEnv changes the class of an intersection's vehicles."""
    wanted = NashVehicle.DISTANCE_WANTED
    make("olne/NashIntersection-v0").reset(seed=0)
    assert NashVehicle.DISTANCE_WANTED == wanted == IDMVehicle.DISTANCE_WANTED


def test_another_traffic_can_be_chosen():
    kind = "olne_bench.envs.traffic.CautiousNashVehicle"
    world = gymnasium.make("olne/NashMerge-v0", config={"other_vehicles_type": kind})
    world.reset(seed=0)
    assert {type(v).__name__ for v in world.unwrapped.road.vehicles[1:]} == {"CautiousNashVehicle"}


@pytest.mark.parametrize("module", ["olne_bench", "olne_bench.envs"])
def test_ids_with_their_module_need_no_import(module):
    lines = f'import gymnasium; gymnasium.make("{module}:olne/NashMerge-v0")'
    subprocess.run([sys.executable, "-c", lines], check=True, timeout=60)


def test_registering_loads_no_simulator():
    lines = (
        'import olne_bench.envs, gymnasium, sys; gymnasium.spec("olne/NashHighway-v0"); '
        'assert not {"highway_env", "pygame", "casadi"} & set(sys.modules)'
    )
    subprocess.run([sys.executable, "-c", lines], check=True, timeout=60)


def test_the_package_alone_does_not_load_gymnasium():
    lines = 'import olne_bench, sys; assert "gymnasium" not in sys.modules'
    subprocess.run([sys.executable, "-c", lines], check=True, timeout=60)


def test_same_seed_same_traffic():
    ends = []
    for _ in range(2):
        world = make("olne/NashRoundabout-v0")
        world.reset(seed=5)
        for _ in range(3):
            world.step(1)
        ends.append(np.array([v.position for v in world.unwrapped.road.vehicles]))
    np.testing.assert_array_equal(*ends)
