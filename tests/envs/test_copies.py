"""Copies and pickles of worlds continue where the original was, and share nothing with it."""

import copy
import pickle

import gymnasium
import highway_env  # noqa: F401  registers HighwayEnv's environments
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

from olne_bench.envs import highway_v0, olne_v0
from olne_bench.envs.roads.highway_roads import ROAD_NAMES
from olne_bench.envs.worlds.wrappers import AWGN, DropSamples, Float32, PartialObservation
from tests.envs.conftest import drawn

WORLDS = {
    **{name: lambda name=name: highway_v0.parallel_env(drawn(name)) for name in ROAD_NAMES},
    "two_player": lambda: olne_v0.parallel_env("two_player"),
    "random": lambda: olne_v0.parallel_env("random", num_players=2),
}
COPIES = {"copied": copy.deepcopy, "pickled": lambda world: pickle.loads(pickle.dumps(world))}


def step(world, rng):
    """A random step of all players who are left."""
    actions = {player: 0.1 * rng.standard_normal(2) * [0.1, 1] for player in world.agents}
    return world.step(actions)


def finish(world, seed):
    """All outputs of a world in the rest of its episode and in the next two."""
    rng = np.random.default_rng(seed)
    told = []
    for _ in range(3):
        while world.agents:
            told.append([step(world, rng), world.state().tobytes()])
        told.append(world.reset())
    return told


@pytest.mark.parametrize("again", COPIES.values(), ids=COPIES)
@pytest.mark.parametrize("name", WORLDS)
def test_a_copy_goes_on_as_the_original(name, again):
    world = WORLDS[name]()
    world.reset(seed=1)
    for _ in range(4):
        step(world, np.random.default_rng(0))
    twin = again(world)
    state = world.state()
    rng = np.random.default_rng(2)
    while world.agents:  # the original moves first and must not move the twin
        step(world, rng)
    assert np.array_equal(twin.state(), state)
    rng = np.random.default_rng(2)
    while twin.agents:
        step(twin, rng)
    assert np.array_equal(twin.state(), world.state())
    assert not np.array_equal(twin.state(), state)


@pytest.mark.parametrize("again", COPIES.values(), ids=COPIES)
def test_random_streams_go_along(again):
    """The sensors' noise and gaps, and the draws of resets without a seed."""
    world = olne_v0.parallel_env("random", num_players=2)
    world = PartialObservation(world, ("px", "py", "heading"))
    world = Float32(DropSamples(AWGN(world, sigma=0.1), p=0.3))
    world.reset(seed=1)
    step(world, np.random.default_rng(0))
    twin = again(world)
    first, second = finish(world, seed=2), finish(twin, seed=2)
    assert len(first) > 60
    assert repr(first) == repr(second)  # missing samples are not equal to themselves


@pytest.mark.parametrize("again", COPIES.values(), ids=COPIES)
@pytest.mark.parametrize(
    "make",
    [
        lambda: olne_v0.env("two_player"),
        lambda: highway_v0.env(drawn("merge")),
        lambda: highway_v0.raw_env(drawn("merge")),
    ],
    ids=["olne_v0.env", "highway_v0.env", "highway_v0.raw_env"],
)
def test_turn_based_worlds(make, again):
    world = make()
    world.reset(seed=1)
    for _ in range(5):  # in the middle of a round
        world.step(world.last()[4]["olne_action"])
    twin = again(world)
    assert twin.agent_selection == world.agent_selection
    while world.agents:
        assert data_equivalence(world.last(), twin.last(), exact=True)
        ended = any(world.last()[2:4])
        action = None if ended else world.last()[4]["olne_action"] + 1e-3
        world.step(action)
        twin.step(action)
    assert twin.agents == []


@pytest.mark.parametrize("mode", ["rgb_array", "human"])
@pytest.mark.parametrize("name", ["merge", "two_player"])
def test_copies_of_worlds_that_have_drawn(name, mode, monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setitem(olne_v0.OlneWorld.metadata, "render_fps", 1000)
    if name == "merge":
        world = highway_v0.parallel_env(drawn(name), render_mode=mode)
    else:
        world = olne_v0.parallel_env(name, render_mode=mode)
    world.reset(seed=1)
    world.render()
    for again in COPIES.values():
        twin = again(world)
        if mode == "rgb_array":
            assert np.array_equal(world.render(), twin.render())
        step(twin, np.random.default_rng(0))
        assert not np.array_equal(twin.state(), world.state())
        twin.close()
    world.close()


@pytest.mark.parametrize("again", COPIES.values(), ids=COPIES)
def test_stock_environments_with_nash_traffic(again):
    config = {
        "other_vehicles_type": "olne_bench.envs.traffic.MixedNashVehicle",
        "vehicles_count": 4,
    }
    world = gymnasium.make("highway-v0", config=config).unwrapped
    world.reset(seed=0)
    world.step(1)
    twin = again(world)
    for action in (3, 0, 1):
        world.step(action)
    for action in (3, 0, 1):
        twin.step(action)
    ends = [[v.position.tolist() for v in env.road.vehicles] for env in (world, twin)]
    assert ends[0] == ends[1]
