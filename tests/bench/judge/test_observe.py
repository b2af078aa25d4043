"""A trial's observation is what the wrapped world showed."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from olne_bench.bench.judge.observe import observe, observed, sensor_model
from olne_bench.envs.olne_v0 import make_world
from olne_bench.envs.sensors.correlated import Correlated
from olne_bench.envs.sensors.drop import Drop
from olne_bench.envs.sensors.full import Full
from olne_bench.envs.sensors.partial import Partial
from olne_bench.envs.sensors.range_bearing import RangeBearing
from olne_bench.envs.worlds.wrappers import wrap

LIDAR = RangeBearing((-3.0, -3.0), np.pi / 4).layers()
SENSORS = {
    "full": Full().layers(),
    "partial": Partial().layers(),
    "range_bearing": LIDAR,
    "gappy": Partial().layers() + Drop(0.3).layers(),
    "correlated": Correlated(0.7).layers(),
    "all at once": LIDAR + Correlated(-0.5).layers() + Drop(0.2).layers(),
}


@pytest.fixture(scope="module")
def recording(recorded):
    return recorded("two_player")


def shown_by(world, seed):
    """What player_0 of a world in its equilibrium sees, (T, N, d)."""
    shown, infos = world.reset(seed=seed)
    frames = [shown["player_0"]]
    while world.agents:
        actions = {player: infos[player]["olne_action"] for player in world.agents}
        shown, *_, infos = world.step(actions)
        frames.append(shown["player_0"])
    return np.array([world.observation_layout.by_index(one, "player_0") for one in frames])


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_recording_shows_what_the_live_world_showed(recording, sensor):
    layers, scenario = SENSORS[sensor], recording.scenario
    for seed in (0, 3):
        (one,) = observe([recording], layers, 0.1, seed)
        live = wrap(make_world(scenario), layers, 0.1, scenario.noise_scale)
        np.testing.assert_array_equal(one.y, shown_by(live, seed))


@pytest.mark.parametrize("sensor", ["full", "gappy", "correlated"])
def test_so_does_one_of_a_road(recorded, sensor):
    road = recorded("merge", 0)
    layers, scenario = SENSORS[sensor], road.scenario
    assert scenario.world == "highway_v0"
    (one,) = observe([road], layers, 0.5, seed=2)
    live = wrap(make_world(scenario), layers, 0.5, scenario.noise_scale)
    np.testing.assert_array_equal(one.y, shown_by(live, 2))


def test_recorded_worlds_show_one_agent_and_one_step_more(recording):
    world = recording.world()
    world.reset()
    assert world.possible_agents == ["player_0"]
    assert world.observation_layout.num_players == 2
    steps = 0
    while world.agents:
        assert world.observation_space("player_0").contains(world.state())
        world.step({})
        steps += 1
    assert steps == len(recording.states)
    np.testing.assert_array_equal(world.state()[:-1], recording.extra_state.ravel())
    assert world.step({}) == ({}, {}, {}, {}, {})


@pytest.mark.parametrize("sensor", ["full", "partial", "range_bearing", "correlated"])
def test_without_noise_one_sees_h(recording, sensor):
    (one,) = observe([recording], SENSORS[sensor], 0.0, seed=0)
    model = sensor_model(recording.scenario, SENSORS[sensor])
    expected = observed(model.view, recording)
    np.testing.assert_array_equal(one.y, expected[:-1])
    np.testing.assert_array_equal(one.extra, expected[-1])


@pytest.mark.parametrize("sensor", SENSORS)
def test_noise_after_h_has_the_covariance_of_the_model(recording, sensor):
    model = sensor_model(recording.scenario, SENSORS[sensor])
    exact = observed(model.view, recording)[:-1]
    noise = np.array(
        [observe([recording], SENSORS[sensor], 0.2, s)[0].y - exact for s in range(200)]
    )
    rows = noise[np.isfinite(noise).all(axis=-1)]
    scale = 0.04 * np.outer(model.noise_scale, model.noise_scale)
    found = (rows.T @ rows) / len(rows)
    assert np.abs((found - 0.04 * np.array(model.covariance)) / scale).max() < 0.05
    assert (np.abs(rows.mean(axis=0)) < 0.01 * np.array(model.noise_scale)).all()
    between = noise[:, 1:, 0, 0] * noise[:, :-1, 0, 0], noise[:, :, 0, 0] * noise[:, :, 1, 0]
    assert all(abs(np.nanmean(product)) < 0.05 * scale[0, 0] for product in between)


def test_sensors_share_the_noise_on_what_they_share(recording):
    noise = {}
    for name in ("full", "partial", "gappy"):
        (one,) = observe([recording], SENSORS[name], 0.1, seed=3)
        noise[name] = np.concatenate([one.y, one.extra[None]])
    np.testing.assert_array_equal(noise["full"][..., :3], noise["partial"])
    seen = np.isfinite(noise["gappy"])
    np.testing.assert_array_equal(noise["gappy"][seen], noise["partial"][seen])
    turned = Partial(("heading", "py")).layers()
    (one,) = observe([recording], turned, 0.1, seed=3)
    np.testing.assert_array_equal(one.y, noise["full"][:-1, :, [2, 1]])


def test_gaps_are_blocks_as_frequent_as_said(recording):
    many = [observe([recording], SENSORS["gappy"], 0.1, s)[0].y for s in range(100)]
    missing = np.isnan(np.array(many))
    assert (missing.all(axis=-1) == missing.any(axis=-1)).all()
    assert abs(missing.mean() - 0.3) < 0.03
    assert abs(np.corrcoef(missing[..., 0].reshape(-1, 2).T)[0, 1]) < 0.05


def test_the_same_seed_shows_the_same_and_another_another(recording):
    first, again, other = (
        observe([recording], SENSORS["all at once"], 0.1, seed)[0].y for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other, equal_nan=True)


def test_a_level_scales_the_draw(recording):
    exact = observed(sensor_model(recording.scenario, LIDAR).view, recording)[:-1]
    low, high = (observe([recording], LIDAR, sigma, 5)[0].y - exact for sigma in (0.1, 0.3))
    np.testing.assert_allclose(high, 3 * low, rtol=1e-9, atol=1e-12)


def test_every_trajectory_has_noise_of_its_own(recording):
    others = [recording, recording, replace(recording)]
    several = [one.y - recording.states for one in observe(others, SENSORS["full"], 0.1, 7)]
    for one, other in combinations(several, 2):
        assert not np.isclose(one, other).any()
    (alone,) = observe([recording], SENSORS["full"], 0.1, 7)
    np.testing.assert_array_equal(alone.y - recording.states, several[0])


def test_noise_has_the_scale_of_the_scenario(recording):
    scale = (1.0, 1.0, 0.1, 2.0)
    scaled = replace(recording, scenario=replace(recording.scenario, noise_scale=scale))
    plain, other = (
        observe([one], SENSORS["full"], 0.3, 4)[0].y - recording.states
        for one in (recording, scaled)
    )
    np.testing.assert_allclose(other, plain * scale, rtol=1e-9, atol=1e-12)


def test_a_sensor_that_is_passed_behind_is_refused(recording):
    turned = RangeBearing((0.0, -3.0), -np.pi / 2).layers()
    with pytest.raises(ValueError, match=r"player \d of 'two_player' passes behind it"):
        observe([recording], turned, 0.1, 0)
