"""The world on HighwayEnv's simulator: exact replay, equilibrium, termination, pictures, errors."""

import itertools
from functools import partial

import gymnasium
import highway_env  # noqa: F401  registers HighwayEnv's environments
import numpy as np
import pytest
from highway_env.vehicle.kinematics import Vehicle
from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test, seed_test

from olne_bench.envs import highway_v0
from olne_bench.envs.roads.highway_roads import (
    DT,
    POLICY_FREQUENCY,
    ROAD_NAMES,
    SIMULATION_FREQUENCY,
)
from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.solved.equilibrium import certified_equilibrium
from tests.envs.conftest import drawn

SEEDS = (0, 1)
EXACT = 1e-9  # [m], [rad], [m/s]


def play(world, deviation=None):
    """Play the OLNE, one player adding a deviation (T-1, 2); states (T, N, 4), returns (N,)."""
    _, infos = world.reset()
    states, returns, step = [world.state()[:-1].reshape(-1, 4)], {}, 0
    while world.agents:
        actions = {player: infos[player]["olne_action"] for player in world.agents}
        if deviation is not None:
            player, offsets = deviation
            actions[player] = actions[player] + offsets[step]
        _, rewards, _, _, infos = world.step(actions)
        for player, reward in rewards.items():
            returns[player] = returns.get(player, 0.0) + reward
        states.append(world.state()[:-1].reshape(-1, 4))
        step += 1
    return np.stack(states), np.array([returns[p] for p in world.possible_agents])


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", ROAD_NAMES)
def test_plan_replays_exactly_and_returns_are_the_costs(name, seed):
    scenario = drawn(name, seed)
    truth = certified_equilibrium(scenario)
    states, returns = play(highway_v0.parallel_env(scenario))
    assert truth.certificate.passed
    assert np.abs(states - truth.states).max() < EXACT
    np.testing.assert_allclose(returns, -truth.certificate.costs, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", ["highway", "intersection"])
def test_plan_replays_exactly_in_the_stock_environment(name):
    """HighwayEnv as installed, with only the configuration changed."""
    scenario = drawn(name)
    truth = certified_equilibrium(scenario)
    count = scenario.game.num_players
    control = {"type": "ContinuousAction", "acceleration_range": [-12, 12]}
    config = {
        "simulation_frequency": SIMULATION_FREQUENCY,
        "policy_frequency": POLICY_FREQUENCY,
        "controlled_vehicles": count,
        "action": {"type": "MultiAgentAction", "action_config": control},
        "observation": {
            "type": "MultiAgentObservation",
            "observation_config": {"type": "Kinematics"},
        },
        "spawn_probability": 0.0,
        "initial_vehicle_count": 1,
        "vehicles_count": 0,
    }
    version = {"highway": "highway-v0", "intersection": "intersection-v2"}[name]
    world = gymnasium.make(version, config=config).unwrapped
    world.reset(seed=0)
    world.road.vehicles = world.controlled_vehicles
    for vehicle, (px, py, heading, speed) in zip(
        world.controlled_vehicles, scenario.initial_state, strict=True
    ):
        vehicle.position = np.array([px, py])
        vehicle.heading, vehicle.speed = float(heading), float(speed)
    for controls, expected in zip(truth.controls, truth.states[1:], strict=True):
        # HighwayEnv's steering range is pi/4 unless told otherwise.
        world.step(tuple((a / 12, s / (np.pi / 4)) for s, a in controls.tolist()))
        states = [[*v.position, v.heading, v.speed] for v in world.controlled_vehicles]
        assert np.abs(np.array(states) - expected).max() < EXACT
    assert world.time == pytest.approx(DT * len(truth.controls))


@pytest.mark.parametrize("name", ROAD_NAMES)
def test_no_small_unilateral_deviation_gains(name):
    """A few deviations of each player."""
    world = highway_v0.parallel_env(drawn(name))
    _, olne_returns = play(world)
    certificate = certified_equilibrium(drawn(name)).certificate
    allowed = certificate.tolerance * (1 + np.abs(certificate.costs))
    rng = np.random.default_rng(0)
    for trial in range(9):
        index = trial % len(olne_returns)
        # A steering offset of 1 mrad alone moves a fast car by half a metre over the horizon.
        offsets = 10 ** rng.uniform(-3, -1) * rng.standard_normal((19, 2)) * [0.01, 1.0]
        _, returns = play(world, (f"player_{index}", offsets))
        assert returns[index] <= olne_returns[index] + allowed[index]


@pytest.mark.parametrize("name", ROAD_NAMES)
def test_frames_show_the_moving_cars(name, monkeypatch):
    if name == "highway":  # HighwayEnv's pictures are black then, unless told otherwise
        monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    world = highway_v0.parallel_env(drawn(name), render_mode="rgb_array")
    _, infos = world.reset()
    frames = [world.render()]
    while world.agents:
        *_, infos = world.step({p: infos[p]["olne_action"] for p in world.agents})
        frames.append(world.render())
    world.close()
    assert len(frames) == 20
    for frame in frames:
        assert frame.dtype == np.uint8 and frame.std() > 5
        colourful = np.ptp(frame, axis=-1) > 60  # a car, on grey and white
        assert colourful.sum() > 100
    assert all((a != b).any() for a, b in itertools.pairwise(frames))


def test_fast_cars_overtake():
    truth = certified_equilibrium(drawn("highway"))
    px = truth.states[..., 0]
    assert px[0, 1] < px[0, 0] and px[-1, 1] > px[-1, 0] + Vehicle.LENGTH


def test_a_crash_terminates_the_cars_in_it_alone():
    world = highway_v0.parallel_env(drawn("highway"))
    world.reset()
    gone, steps = {}, 0
    while world.agents:
        # The fast car goes straight on into the slow one ahead of it.
        actions = {player: np.array([0.0, 0.0]) for player in world.agents}
        if "player_1" in actions:
            actions["player_1"][1] = 5.0
        _, rewards, terminations, truncations, infos = world.step(actions)
        steps += 1
        gone |= {player: steps for player, ended in terminations.items() if ended}
        assert rewards.keys() == terminations.keys() == truncations.keys() == infos.keys()
    assert gone["player_0"] == gone["player_1"] < gone["player_2"] == 19


def test_actions_of_a_player_who_left_are_refused():
    world = highway_v0.parallel_env(drawn("highway"))
    world.reset()
    while "player_1" in world.agents:
        world.step({p: np.array([0.0, 5.0 * (p == "player_1")]) for p in world.agents})
    with pytest.raises(ValueError, match="unknown player player_1; players are: player_2"):
        world.step({"player_1": np.zeros(2), "player_2": np.zeros(2)})


def test_pettingzoo_conformance():
    parallel_api_test(highway_v0.parallel_env(drawn("highway")), num_cycles=40)
    api_test(highway_v0.env(drawn("merge")), num_cycles=40)
    parallel_seed_test(partial(highway_v0.parallel_env, drawn("merge")))
    seed_test(partial(highway_v0.env, drawn("merge")), num_cycles=20)


def test_a_closed_world_plays_and_draws_on():
    world = highway_v0.parallel_env(drawn("merge"), render_mode="rgb_array")
    world.reset()
    before = world.render()
    world.close()
    assert np.array_equal(world.render(), before)
    world.step({player: np.array([0.0, 5.0]) for player in world.agents})
    assert not np.array_equal(world.render(), before)
    world.close()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("motorway", "'motorway' has no road in HighwayEnv; known are: highway, "),
        ("two_player", "'two_player' has no road in HighwayEnv"),
    ],
)
def test_scenario_without_a_road(name, message):
    with pytest.raises(ValueError, match=message):
        highway_v0.parallel_env(name)
    world = highway_v0.parallel_env(drawn("merge"))
    with pytest.raises(ValueError, match=message):
        world.reset(options={"scenario": name})
    assert world.reset()[0].keys() == {"player_0", "player_1"}


@pytest.mark.parametrize("seed", [-1, "a", 1.0])
def test_a_seed_that_is_none_leaves_the_world_usable(seed):
    with pytest.raises(ValueError, match=f"a seed is an integer of at least 0, got {seed!r}"):
        get_scenario("merge", seed)
    world = highway_v0.parallel_env(drawn("merge"))
    with pytest.raises(ValueError, match="a seed is an integer of at least 0"):
        world.reset(seed=seed)
    assert world.reset(seed=3)[0].keys() == {"player_0", "player_1"}
