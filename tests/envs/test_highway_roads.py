"""HighwayEnv's vehicle and lanes, and their counterparts in games."""

import casadi as ca
import numpy as np
import pytest
from highway_env.envs.common.abstract import AbstractEnv
from highway_env.road.lane import PolyLaneFixedWidth

from olne_bench.envs.highway_roads import (
    CAR,
    DT,
    ROAD_NAMES,
    SIMULATION_FREQUENCY,
    SUB_STEPS,
    make_road,
    replay,
    road_network,
)
from olne_bench.envs.lane_curves import lane_curve
from olne_bench.envs.playability import rejection
from olne_bench.envs.scenarios import get_scenario
from olne_bench.games.dynamics import bicycle, rollout


@pytest.mark.parametrize("name", ROAD_NAMES)
def test_motion_is_that_of_the_simulator(name):
    rng = np.random.default_rng(0)
    initial = np.array([[100, 0, 0.1, 20.0], [160, 4, -0.1, 15.0], [40, 60, 2.0, 9.0]])
    controls = rng.uniform(-1, 1, (20, 3, 2)) * [0.2, 4.0]
    simulated = replay(name, initial, controls)
    np.testing.assert_allclose(rollout(CAR, initial, controls, DT), simulated, atol=1e-11)


@pytest.mark.parametrize("name", ROAD_NAMES)
def test_lanes_have_the_simulators_coordinates(name):
    for lanes in road_network(name).lanes_dict().values():
        curve = lane_curve(lanes)
        position = ca.SX.sym("p", 2)
        locate = ca.Function("locate", [position], list(curve.locate(position)))
        assert curve.length == pytest.approx(lanes.length)
        for place in np.linspace(0, lanes.length, 5):
            point = lanes.position(place, 0.7)
            along, beside, heading = (float(value) for value in locate(point))
            expected = lanes.local_coordinates(point)
            np.testing.assert_allclose([along, beside], expected, atol=1e-9)
            assert np.sin((heading - lanes.heading_at(expected[0])) / 2) == pytest.approx(
                0, abs=1e-12
            )


def test_the_simulator_runs_at_its_usual_pace():
    assert AbstractEnv.default_config()["simulation_frequency"] == SIMULATION_FREQUENCY
    for name in ROAD_NAMES:
        config = make_road(name).unwrapped.config
        assert config["simulation_frequency"] / config["policy_frequency"] == SUB_STEPS
        assert 1 / config["policy_frequency"] == pytest.approx(DT)


def test_other_lanes_and_roads_are_refused():
    with pytest.raises(ValueError, match="no curve for a PolyLaneFixedWidth; known are: Straight"):
        lane_curve(PolyLaneFixedWidth([(0, 0), (10, 0), (20, 5)]))
    with pytest.raises(ValueError, match="no road for 'racetrack'; known are: highway, inter"):
        make_road("racetrack")


@pytest.mark.parametrize(("argument", "value"), [("sub_steps", 0), ("rear_axle", -1.0)])
def test_bicycle_parameters_are_checked(argument, value):
    with pytest.raises(ValueError, match=f"{argument} must be"):
        bicycle(**{argument: value})


def test_draws_are_seeded_and_playable():
    first, again, other = (get_scenario("two_way", seed, num_players=3) for seed in (5, 5, 6))
    np.testing.assert_array_equal(first.initial_state, again.initial_state)
    np.testing.assert_array_equal(first.weights, again.weights)
    assert first.game == again.game
    assert (first.initial_state != other.initial_state).any()
    assert rejection(first) is None


def test_plans_that_the_simulator_would_interfere_with_are_seen():
    """Two cars side by side: apart as they are, in contact with a margin."""
    initial = np.array([[100, 0, 0, 20.0], [100, 2.3, 0, 20.0]])
    controls = np.zeros((3, 2, 2))
    free = replay("highway", initial, controls)
    np.testing.assert_allclose(free[-1, :, 1], [0, 2.3], atol=1e-12)
    cushioned = replay("highway", initial, controls, margin=0.25)
    assert np.abs(cushioned - free).max() > 0.1
