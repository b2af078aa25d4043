"""Sensors: they show what observation models define, and change nothing else."""

import itertools
import pickle

import numpy as np
import pytest
import supersuit
from gymnasium.spaces import Box
from gymnasium.utils.env_checker import data_equivalence
from pettingzoo.test import parallel_api_test, parallel_seed_test
from pettingzoo.utils import BaseParallelWrapper

from olne_bench.envs import olne_v0
from olne_bench.envs.sensors.correlated import Correlated
from olne_bench.envs.worlds.wrappers import (
    AWGN,
    BoxWithGaps,
    DropSamples,
    Float32,
    ObservationView,
    PartialObservation,
    RangeBearing,
    wrap,
)
from olne_bench.games.model.observation import VIEWS, RangeBearingView, observe
from olne_bench.games.model.sensor import SensorModel

PARTIAL = ("px", "py", "heading")
SENSOR = (-3.0, -2.5)
FACING = 0.6


def world(name="two_player", **arguments):
    return olne_v0.parallel_env(name, **arguments)


STACKS = {
    "noise": lambda env: AWGN(env, 0.1),
    "view": lambda env: PartialObservation(env, PARTIAL),
    "noisy view": lambda env: AWGN(PartialObservation(env, PARTIAL), 0.1),
    "view of noise": lambda env: PartialObservation(AWGN(env, 0.1), PARTIAL),
    "lidar": lambda env: AWGN(RangeBearing(env, SENSOR, FACING), [0.1, 0.01]),
    "lidar's range": lambda env: PartialObservation(RangeBearing(env, SENSOR), ("range",)),
    "lidar in noise": lambda env: RangeBearing(PartialObservation(AWGN(env, 0.1), PARTIAL), SENSOR),
    "everything": lambda env: Float32(DropSamples(AWGN(RangeBearing(env, SENSOR), 0.1), 0.3)),
    "single first": lambda env: DropSamples(
        AWGN(PartialObservation(Float32(env), PARTIAL), 0.1), 0
    ),
    "dropped first": lambda env: AWGN(PartialObservation(DropSamples(env, 0.3), PARTIAL), 0.1),
}


@pytest.fixture(params=STACKS)
def stack(request):
    return STACKS[request.param]


def episode(env, seed=1):
    """All that an OLNE episode shows: observations, (states, rewards), infos."""
    observations, infos = env.reset(seed=seed)
    shown, traffic, told = [observations], [(env.state(), {})], [infos]
    while env.agents:
        observations, rewards, *_, infos = env.step(
            {player: infos[player]["olne_action"] for player in env.agents}
        )
        shown.append(observations)
        traffic.append((env.state(), rewards))
        told.append(infos)
    return shown, traffic, told


def blocks(env, shown, player="player_0"):
    """What a player saw, in the form of estimators' input: (T, N, d)."""
    return np.array([env.observation_layout.by_index(o[player], player) for o in shown])


# -- the traffic does not change -------------------------------------------------------------


def test_no_stack_changes_the_traffic(stack):
    _, traffic, told = episode(world())
    _, seen_traffic, seen_told = episode(stack(world()))
    assert data_equivalence(traffic, seen_traffic, exact=True)
    assert data_equivalence(told, seen_told, exact=True)


def test_no_stack_changes_which_members_are_drawn(stack):
    bare, seen = world("random", num_players=2), stack(world("random", num_players=2))
    for seed in (3, None, None):
        bare.reset(seed=seed)
        seen.reset(seed=seed)
        assert np.array_equal(bare.state(), seen.state())


def test_noise_and_gaps_do_not_depend_on_the_order_of_their_wrappers():
    one = blocks(env := DropSamples(AWGN(world(), 0.1), 0.3), episode(env)[0])
    other = blocks(env := AWGN(DropSamples(world(), 0.3), 0.1), episode(env)[0])
    np.testing.assert_array_equal(one, other)
    assert np.isnan(one).any()
    assert np.isfinite(one).any()


# -- views are the estimators' observation models --------------------------------------------


@pytest.mark.parametrize("view", [*VIEWS.values(), RangeBearingView(SENSOR, FACING)])
def test_wrappers_see_what_estimators_expect(view):
    env = ObservationView(world("highway_overtaking"), view)
    shown, traffic, _ = episode(env)
    states = np.array([state[:-1].reshape(5, 4) for state, _ in traffic])
    expected = observe(view, env.unwrapped.scenario.game.dynamics, states)
    for player in env.possible_agents:
        assert np.array_equal(blocks(env, shown, player), expected)
    times = [observations["player_0"][-1] for observations in shown]
    assert np.array_equal(times, np.arange(20.0))


# -- noise -----------------------------------------------------------------------------------


def noise_of(stacked, seed=1):
    """Noise (T, N, d) that player_0 saw in a stack of additive noise on full states."""
    shown, traffic, _ = episode(stacked, seed)
    count = len(stacked.possible_agents)
    states = np.array([state[:-1].reshape(count, -1) for state, _ in traffic])
    return blocks(stacked, shown) - states


def many_draws(stacked, seeds=40):
    return np.concatenate([noise_of(stacked, seed).reshape(-1, 4) for seed in range(seeds)])


def test_noise_has_the_covariance_asked_for():
    root = np.array([[0.2, 0, 0, 0], [0.1, 0.1, 0, 0], [0, 0, 0.05, 0], [0, 0, 0.3, 0]])
    covariance = root @ root.T  # singular: the last two components move together
    draws = many_draws(AWGN(world(), covariance=covariance))
    assert len(draws) == 2000
    assert np.abs(draws.mean(axis=0)).max() < 0.02
    assert np.abs(np.cov(draws.T) - covariance).max() < 0.01
    assert np.allclose(draws[:, 3], 6 * draws[:, 2])


def test_noise_per_component():
    draws = many_draws(AWGN(world(), sigma=[0.1, 0.2, 0.0, 0.4]))
    assert np.allclose(draws.std(axis=0), [0.1, 0.2, 0.0, 0.4], rtol=0.06)
    assert (draws[:, 2] == 0).all()


@pytest.mark.parametrize("sigma", [0.0, 0.03, 2.0])
def test_a_sensors_noise_is_scaled_by_the_scenario_to_the_last_bit(sigma):
    scale = np.array([1.0, 0.7, 0.1, 3.3])
    wrapped = wrap(world(), (VIEWS["full"],), sigma, scale)
    np.testing.assert_array_equal(noise_of(wrapped), noise_of(AWGN(world(), sigma * scale)))


def test_views_share_the_draw_of_the_noise_below_them():
    full = blocks(env := AWGN(world(), 0.1), episode(env)[0])
    partial = blocks(env := PartialObservation(AWGN(world(), 0.1), PARTIAL), episode(env)[0])
    assert np.array_equal(partial, full[..., :3])


def test_streams_follow_the_seed_and_are_independent_of_each_other():
    env = AWGN(world(), 1.0)
    assert np.array_equal(noise_of(env, 1), noise_of(env, 1))
    assert not np.allclose(noise_of(env, 1), noise_of(env, 2))
    seeded, unseeded = noise_of(env, 1), noise_of(env, None)  # the stream continues
    assert not np.allclose(seeded, unseeded)
    env.reset(seed=1)
    episode(env, 1)
    assert np.array_equal(noise_of(env, None), unseeded)

    twice = many_draws(AWGN(AWGN(world(), 1.0), 1.0))
    assert np.allclose(twice.std(axis=0), np.sqrt(2), rtol=0.06)


def test_every_player_and_every_kind_of_sensor_has_a_stream_of_its_own():
    noisy, clean = episode(AWGN(world(), 1.0))[0][0], episode(world())[0][0]
    first, second = ((noisy[p] - clean[p])[:-1] for p in ("player_0", "player_1"))
    assert not np.isclose(first, second).any()
    assert AWGN.key != DropSamples.key


def test_without_any_seed_noise_differs_between_worlds():
    assert not np.allclose(noise_of(AWGN(world(), 1.0), None), noise_of(AWGN(world(), 1.0), None))


# -- gaps ------------------------------------------------------------------------------------


def test_missed_players_are_nan_as_often_as_asked():
    env = DropSamples(world("highway_overtaking"), 0.25)
    seen = np.concatenate([blocks(env, episode(env, seed)[0]) for seed in range(10)])
    missing = np.isnan(seen)
    assert (missing.all(axis=-1) == missing.any(axis=-1)).all()  # a block as a whole
    assert abs(missing.mean() - 0.25) < 0.05
    assert 0 < missing.all(axis=-1)[:, 0].mean() < 1  # one's own block as well


@pytest.mark.parametrize("p", [0.0, 1.0])
def test_certain_gaps(p):
    env = DropSamples(world(), p)
    shown, _, _ = episode(env)
    assert (np.isnan(blocks(env, shown)) == bool(p)).all()
    assert [o["player_1"][-1] for o in shown] == [0.25 * t for t in range(25)]


def test_box_with_gaps_contains_gaps_but_nothing_else_new():
    box = BoxWithGaps(np.zeros(2), np.ones(2), dtype=np.float64)
    assert box.contains(np.array([np.nan, 0.5]))
    assert box.contains(np.array([np.nan, np.nan]))
    assert not box.contains(np.array([np.nan, 1.5]))
    assert not box.contains(np.array([np.nan, 0.5, 0.5]))
    assert not Box(np.zeros(2), np.ones(2), dtype=np.float64).contains(np.array([np.nan, 0.5]))


# -- single precision ------------------------------------------------------------------------


def test_single_precision_keeps_the_plan_exact():
    env = Float32(world())
    shown, traffic, _ = episode(env)
    returns = sum(np.array([*rewards.values(), 0, 0][:2]) for _, rewards in traffic)
    assert np.abs(returns + env.unwrapped.certificate.costs).max() < 1e-9
    assert all(o.dtype == np.float32 for observations in shown for o in observations.values())


def test_single_precision_actions_are_within_the_worlds_bounds():
    """2 pi, a bound of the family, is larger in single precision than in double."""
    env = Float32(world("random", num_players=2, reveal_truth=False))
    for bound in ("low", "high"):
        env.reset(seed=0)
        actions = {player: getattr(env.action_space(player), bound) for player in env.agents}
        assert all(action.dtype == np.float32 for action in actions.values())
        env.step(actions)


# -- spaces and conformance ------------------------------------------------------------------


def test_spaces_contain_what_is_shown(stack):
    env = stack(world("highway_overtaking", reveal_truth=False))
    rng = np.random.default_rng(0)
    observations, _ = env.reset(seed=0)
    while env.agents:
        for player, observation in observations.items():
            space = env.observation_space(player)
            assert space.contains(observation), (space, observation)
            assert space is env.observation_space(player)
            assert space.is_bounded()
            assert space.shape == (env.observation_layout.size,)
        observations, *_ = env.step(
            {player: rng.choice([-1, 1]) * env.action_space(player).high for player in env.agents}
        )


def test_range_never_exceeds_its_bound():
    env = RangeBearing(world("two_player", reveal_truth=False), (5.0, -30.0))
    assert env.observation_space("player_0").high[0] == pytest.approx(np.hypot(25, 50))
    assert env.observation_space("player_0").low[0] == 0


@pytest.mark.filterwarnings("ignore:Observation contains NaNs")
def test_stacks_conform_to_pettingzoo(stack):
    parallel_api_test(stack(world()), num_cycles=30)
    observation = stack(world()).reset(seed=42)[0]["player_0"]
    if np.isfinite(observation).all():  # upstream's comparison does not treat gaps as equal
        parallel_seed_test(lambda: stack(world()))


def test_same_seed_same_observations_over_whole_episodes(stack):
    first, second = stack(world()), stack(world())
    for seed in (1, None):  # the second episode continues the streams of the first
        shown, again = (
            blocks(first, episode(first, seed)[0]),
            blocks(second, episode(second, seed)[0]),
        )
        np.testing.assert_array_equal(shown, again)


def test_pickled_stacks_show_the_same(stack):
    env = stack(world())
    copy = pickle.loads(pickle.dumps(env))
    np.testing.assert_array_equal(blocks(env, episode(env)[0]), blocks(copy, episode(copy)[0]))


def test_stacks_follow_a_change_of_scenario(stack):
    env = stack(world(reveal_truth=False))
    observations, _ = env.reset(seed=0, options={"scenario": "random", "num_players": 3})
    assert len(observations) == 3
    for player, observation in observations.items():
        assert env.observation_space(player).contains(observation)
    observations, _ = env.reset()
    assert env.observation_space("player_0").contains(observations["player_0"])


# -- other libraries' wrappers ---------------------------------------------------------------

ABOVE = {
    "dtype": lambda env: supersuit.dtype_v0(env, "float32"),
    "frame_stack": lambda env: supersuit.frame_stack_v1(env, 3),
    "normalize_obs": supersuit.normalize_obs_v0,
    "pad": lambda env: supersuit.pad_observations_v0(supersuit.pad_action_space_v0(env)),
    "black_death": supersuit.black_death_v3,
}
BELOW = {
    "dtype": lambda env: supersuit.dtype_v0(env, "float32"),
    "clip_actions": supersuit.clip_actions_v0,
    "clip_reward": supersuit.clip_reward_v0,
    "frame_skip": lambda env: supersuit.frame_skip_v0(env, 2),
    "sticky_actions": lambda env: supersuit.sticky_actions_v0(env, 0.25),
    "delay": lambda env: supersuit.delay_observations_v0(env, 2),
    "black_death": supersuit.black_death_v3,
}


def play_idle(env):
    observations, _ = env.reset(seed=1)
    shown = [observations]
    for _ in range(100):
        if not env.agents:
            break
        observations, *_ = env.step(
            {player: np.zeros(env.action_space(player).shape) for player in env.agents}
        )
        shown.append(observations)
    assert not env.agents
    return shown


@pytest.mark.parametrize("above", ABOVE)
def test_supersuit_above_sensors(above):
    env = ABOVE[above](AWGN(PartialObservation(world(), PARTIAL), 0.1))
    for observations in play_idle(env):
        for player, observation in observations.items():
            assert env.observation_space(player).shape == observation.shape
            assert env.observation_space(player).contains(observation)


@pytest.mark.parametrize("below", BELOW)
def test_supersuit_below_sensors(below):
    env = AWGN(PartialObservation(BELOW[below](world()), PARTIAL), 0.1)
    same = play_idle(AWGN(PartialObservation(BELOW[below](world()), PARTIAL), 0.1))
    for observations, again in itertools.zip_longest(play_idle(env), same):
        assert data_equivalence(observations, again, exact=True)
        for observation in observations.values():
            assert observation.shape == (env.observation_layout.size,)


def test_supersuit_between_sensors_keeps_the_nearest_layout():
    env = AWGN(supersuit.dtype_v0(PartialObservation(world(), PARTIAL), "float32"), 0.1)
    assert env.observation_layout.state_names == PARTIAL
    assert episode(env)[0][0]["player_0"].dtype == np.float32


def test_supersuit_vector_env_for_learners():
    env = Float32(AWGN(PartialObservation(world(), PARTIAL), 0.1))
    vector = supersuit.concat_vec_envs_v1(
        supersuit.pettingzoo_env_to_vec_env_v1(env), 2, num_cpus=0, base_class="gymnasium"
    )
    observations, _ = vector.reset(seed=0)
    assert observations.shape == (4, 7)
    for _ in range(60):  # beyond two episodes: it resets by itself
        observations, *_ = vector.step(np.zeros((4, 2), dtype=np.float32))
        assert np.isfinite(observations).all()


# -- bad input -------------------------------------------------------------------------------


class Doubled(BaseParallelWrapper):
    """Repeats observations, so that no sensor can split them."""

    def observation_space(self, agent):
        below = self.env.observation_space(agent)
        return Box(np.tile(below.low, 2), np.tile(below.high, 2), dtype=np.float64)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PartialObservation(world(), ("px", "velocity")), "'velocity'.*px, py, heading"),
        (lambda: PartialObservation(world(), ()), "components must be a list"),
        (lambda: PartialObservation(world(), "px"), "components must be a list.*'px'"),
        (
            lambda: RangeBearing(PartialObservation(world(), ("px",))),
            "'range_bearing'.*no component 'py' here; there are: px",
        ),
        (lambda: AWGN(world()), "either sigma or covariance"),
        (lambda: AWGN(world(), 0.1, covariance=np.eye(4)), "either sigma or covariance"),
        (lambda: AWGN(world(), -0.1), "non-negative, got -0.1"),
        (lambda: AWGN(world(), float("nan")), "finite.*nan"),
        (
            lambda: AWGN(world(), [0.1, 0.2]),
            r"sigma has the shape \(2,\), expected one number or 4",
        ),
        (lambda: AWGN(world(), covariance=np.eye(3)), r"\(3, 3\), expected \(4, 4\)"),
        (lambda: AWGN(world(), covariance=np.diag([1, 1, 1, -1])), "negative eigenvalue -1"),
        (lambda: AWGN(world(), covariance=np.triu(np.ones((4, 4)))), "symmetric"),
        (lambda: DropSamples(world(), 1.5), "between 0 and 1, got 1.5"),
        (lambda: DropSamples(world(), float("nan")), "between 0 and 1, got nan"),
        (lambda: AWGN(Doubled(world()), 0.1), r"AWGN needs.*\(9,\).*give \(18,\)"),
        (lambda: AWGN(supersuit.frame_stack_v1(world(), 4), 0.1), r"give \(36,\)"),
    ],
)
def test_bad_arguments(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_world_without_a_layout():
    class Foreign:
        possible_agents = ("player_0",)

    with pytest.raises(ValueError, match="no observation_layout"):
        AWGN(Foreign(), 0.1)


@pytest.mark.parametrize("sigma", [0.1, 0.5])
def test_a_sensors_correlated_noise_has_the_covariance_of_its_model(sigma):
    layers, scale = Correlated(0.7).layers(), np.array([1.0, 0.7, 0.1, 3.3])
    model = SensorModel.of(layers, world().observation_layout, scale)
    draws = many_draws(wrap(world(), layers, sigma, scale), seeds=20) / (sigma * scale)
    relative = np.array(model.covariance) / np.outer(scale, scale)
    assert np.abs(relative - np.eye(4)).max() > 0.5
    assert np.abs(np.cov(draws.T) - relative).max() < 0.15
