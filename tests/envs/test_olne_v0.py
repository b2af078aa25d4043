"""The PettingZoo world: conformance, truth, equilibrium, bad input."""

import functools
from types import SimpleNamespace

import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import data_equivalence
from pettingzoo.test import (
    api_test,
    max_cycles_test,
    parallel_api_test,
    parallel_seed_test,
    render_test,
    seed_test,
)
from pettingzoo.test.state_test import state_test

from olne_bench.envs import olne_v0
from olne_bench.envs.recordings.recording import NoEquilibriumError, record
from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.scenarios.scenario import Limits, Scenario
from olne_bench.games.model.costs import ControlEffort, StateDeviation
from olne_bench.games.model.dynamics import DOUBLE_INTEGRATOR, rollout
from olne_bench.games.model.game import Game, Player

GAMES = {
    "two_player": ("two_player", {}),
    "highway_overtaking": ("highway_overtaking", {}),
    "random": ("random", {}),  # with another number of players in every episode
    "random of 3": ("random", {"num_players": 3}),
}


@pytest.fixture(params=GAMES)
def make(request):
    """Constructors of one world, like the module ``olne_v0``."""
    name, options = GAMES[request.param]
    return SimpleNamespace(
        parallel_env=functools.partial(olne_v0.parallel_env, name, **options),
        env=functools.partial(olne_v0.env, name, **options),
        raw_env=functools.partial(olne_v0.raw_env, name, **options),
    )


@pytest.fixture
def no_window(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")


def plan(infos, players):
    return {player: infos[player]["olne_action"] for player in players}


def play(world, controls):
    """Returns (N,) and states (T, N, n) of open-loop controls (T-1, N, m)."""
    states = [world.state()]
    returns = np.zeros(len(world.agents))
    for control in controls:
        _, rewards, *_ = world.step(dict(zip(world.agents, control, strict=True)))
        returns += list(rewards.values())
        states.append(world.state())
    return returns, np.array(states)[:, :-1].reshape(len(states), len(returns), -1)


def played_actions(world, infos):
    """The controls (T-1, N, m) of the OLNE, from infos."""
    actions = []
    while world.agents:
        actions.append(plan(infos, world.agents))
        *_, infos = world.step(actions[-1])
    return np.array([list(step.values()) for step in actions])


# -- PettingZoo's own conformance tests ------------------------------------------------------


def test_parallel_api(make):
    parallel_api_test(make.parallel_env(), num_cycles=100)


def test_api(make):
    api_test(make.env(), num_cycles=100)


def test_upstream_seed_tests(make):
    parallel_seed_test(make.parallel_env)
    seed_test(make.env)


def test_max_cycles(make):
    max_cycles_test(make)


@pytest.mark.usefixtures("no_window")
def test_upstream_render_test(make):
    render_test(make.env)


def test_upstream_state_test(make):
    state_test(make.env(), make.parallel_env())


# -- determinism -----------------------------------------------------------------------------


def test_same_seed_same_world_over_whole_episodes(make):
    """Upstream compares one step; this compares three episodes, two of them unseeded."""
    first, second = make.parallel_env(), make.parallel_env()
    rng = np.random.default_rng(0)
    for seed in (5, None, None):
        assert data_equivalence(first.reset(seed=seed), second.reset(seed=seed), exact=True)
        steps = 0
        while first.agents:
            actions = {
                player: rng.uniform(space.low, space.high)
                for player in first.agents
                for space in [first.action_space(player)]
            }
            assert data_equivalence(first.step(actions), second.step(actions), exact=True)
            assert np.array_equal(first.state(), second.state())
            steps += 1
        assert steps == first.scenario.game.horizon - 1
        assert second.agents == []


def test_a_family_draws_another_member_for_each_reset():
    world = olne_v0.parallel_env("random", num_players=2)
    starts = []
    for seed in (1, 2, None, None):
        world.reset(seed=seed)
        starts.append(tuple(world.state()))
    assert len(set(starts)) == 4


def test_reset_seed_is_the_scenario_seed():
    world = olne_v0.parallel_env("random")
    for seed in (0, 3):
        world.reset(seed=seed)
        expected = get_scenario("random", seed)
        assert np.array_equal(world.scenario.weights, expected.weights)
        assert np.array_equal(world.scenario.initial_state, expected.initial_state)


# -- the equilibrium -------------------------------------------------------------------------


def test_olne_episode_returns_minus_its_certified_costs(make):
    world = make.parallel_env()
    _, infos = world.reset(seed=1)
    actions = played_actions(world, infos)
    world.reset(seed=1)
    returns, states = play(world, actions)
    truth = record(world.scenario)
    assert np.abs(returns + world.certificate.costs).max() < 1e-9
    assert np.abs(states - truth.states).max() < 1e-9
    game = world.scenario.game
    assert np.array_equal(states, rollout(game.dynamics, states[0], actions, game.dt))


def test_turn_based_form_plays_the_same_equilibrium():
    world = olne_v0.env("two_player")
    world.reset()
    returns = dict.fromkeys(world.agents, 0.0)
    for player in world.agent_iter():
        _, reward, terminated, truncated, info = world.last()
        returns[player] += reward
        world.step(None if terminated or truncated else info["olne_action"])
    costs = world.unwrapped.certificate.costs
    assert np.abs(np.array(list(returns.values())) + costs).max() < 1e-9


@pytest.mark.parametrize(
    ("name", "options", "seed"),
    [("two_player", {}, 0), ("highway_overtaking", {}, 0), ("random", {"num_players": 3}, 1)],
)
def test_no_small_unilateral_deviation_pays(name, options, seed):
    """Random changes of one player's actions, through the public API alone."""
    world = olne_v0.parallel_env(name, **options)
    _, infos = world.reset(seed=seed)
    olne = played_actions(world, infos)
    tolerance = world.certificate.tolerance
    world.reset(seed=seed)
    olne_returns, _ = play(world, olne)
    rng = np.random.default_rng(7)
    gains = np.empty(300)
    for trial in range(len(gains)):
        player = trial % len(olne_returns)
        size = 10 ** rng.uniform(-5, -1.5)
        changed = olne.copy()
        changed[:, player] += size * rng.standard_normal(olne[:, player].shape)
        world.reset(seed=seed)
        returns, _ = play(world, changed)
        gains[trial] = (returns - olne_returns)[player] / (1 + abs(olne_returns[player]))
    assert gains.max() <= tolerance
    assert gains.min() < -1e-4  # the deviations did matter


def test_final_cost_is_charged_once_and_only_at_the_horizon():
    world = olne_v0.parallel_env("two_player")
    short = olne_v0.parallel_env("two_player", max_cycles=23)
    idle = {player: np.zeros(2) for player in world.possible_agents}
    world.reset()
    short.reset()
    for _ in range(23):
        _, rewards, terminated, truncated, _ = world.step(idle)
        _, short_rewards, short_terminated, short_truncated, _ = short.step(idle)
        assert rewards == short_rewards
        assert not any([*terminated.values(), *truncated.values(), *short_terminated.values()])
    assert all(short_truncated.values())
    assert short.agents == []
    _, last, terminated, truncated, _ = world.step(idle)
    assert all(terminated.values())
    assert not any(truncated.values())
    # Goals are a metre away, weighted with 100/4 of the row sum: nothing else costs as much.
    assert all(last[p] < -10 < rewards[p] for p in last)


# -- observations, infos, spaces -------------------------------------------------------------


def test_observation_is_own_state_others_and_time():
    world = olne_v0.parallel_env("random", num_players=3)
    world.reset(seed=2)
    observations, *_ = world.step({p: np.array([0.3, -0.2]) for p in world.agents})
    states = world.state()[:-1].reshape(3, 4)
    time = world.scenario.game.dt
    expected = np.array([*states[1], *states[0], *states[2], time])
    assert np.array_equal(observations["player_1"], expected)
    assert observations["player_1"].dtype == np.float64
    for player, observation in observations.items():
        assert np.array_equal(world.observation_layout.by_index(observation, player), states)


def test_infos_carry_the_truth_or_hide_it():
    world = olne_v0.parallel_env("two_player")
    _, infos = world.reset()
    truth = record(world.scenario)
    for t in range(24):
        for i, player in enumerate(world.agents):
            assert np.array_equal(infos[player]["weights"], truth.scenario.weights[i])
            assert np.array_equal(infos[player]["olne_action"], truth.controls[t, i])
        *_, infos = world.step(plan(infos, world.agents))
    assert all(info.keys() == {"weights"} for info in infos.values())

    hidden = olne_v0.parallel_env("two_player", reveal_truth=False)
    _, infos = hidden.reset()
    assert infos == {"player_0": {}, "player_1": {}}
    assert hidden.certificate is None
    *_, infos = hidden.step({p: np.zeros(2) for p in hidden.agents})
    assert infos == {"player_0": {}, "player_1": {}}


def test_what_the_world_hands_out_cannot_change_it():
    world = olne_v0.parallel_env("two_player")
    observations, infos = world.reset()
    clean = olne_v0.parallel_env("two_player")
    _, clean_infos = clean.reset()
    state = world.state()
    for array in (state, *observations.values()):
        array[:] = 99.0
    for info in infos.values():
        info["olne_action"][:] = 0.0
        info["weights"][:] = 0.0
    step = world.step(plan(clean_infos, world.agents))
    assert data_equivalence(step, clean.step(plan(clean_infos, clean.agents)), exact=True)
    world.reset()
    clean.reset()
    assert np.array_equal(world.state(), clean.state())


@pytest.mark.parametrize("name", ["two_player", "highway_overtaking", "random"])
def test_spaces_are_finite_and_hold_whatever_is_played(name):
    world = olne_v0.parallel_env(name, reveal_truth=False)
    for corner in ((1, 1), (1, -1), (-1, 1), (-1, -1), (0, 1), (0, -1)):
        observations, _ = world.reset(seed=1)
        while world.agents:
            for player, observation in observations.items():
                assert world.observation_space(player).contains(observation)
            assert world.state_space.contains(world.state())
            actions = {p: world.action_space(p).high * corner for p in world.agents}
            observations, *_ = world.step(actions)
    for player in world.possible_agents:
        assert world.observation_space(player).is_bounded()
        assert world.observation_space(player) is world.observation_space(player)
        assert world.action_space(player).is_bounded()


def test_spaces_stay_the_same_objects_within_a_family():
    world = olne_v0.parallel_env("random", num_players=2, reveal_truth=False)
    spaces = [world.observation_space("player_0"), world.action_space("player_1")]
    for seed in range(3):
        world.reset(seed=seed)
        assert world.observation_space("player_0") is spaces[0]
        assert world.action_space("player_1") is spaces[1]


def test_options_choose_the_scenario_of_one_episode():
    world = olne_v0.parallel_env("two_player", reveal_truth=False)
    observations, _ = world.reset(seed=3, options={"scenario": "random", "num_players": 4})
    assert world.scenario.name == "random"
    assert list(observations) == world.agents == world.possible_agents
    assert world.num_agents == 4
    assert world.observation_space("player_3").contains(observations["player_3"])
    world.reset()
    assert world.scenario.name == "two_player"
    assert world.possible_agents == ["player_0", "player_1"]


def test_options_of_the_worlds_own_scenario():
    world = olne_v0.parallel_env("random", num_players=2, reveal_truth=False)
    world.reset(seed=0, options={"num_players": 3})
    assert world.num_agents == 3


def test_converted_world_follows_a_change_of_scenario():
    world = olne_v0.env("two_player", reveal_truth=False)
    world.reset(options={"scenario": "highway_overtaking"})
    assert len(world.possible_agents) == len(world.agents) == 5
    assert world.state_space.contains(world.state())


# -- bad input -------------------------------------------------------------------------------


def never_settles() -> Scenario:
    """A player that gains without bound from going faster: no equilibrium."""
    player = Player((StateDeviation("vx", scale=-1.0), ControlEffort("ax", scale=1e-3)))
    return Scenario(
        name="never_settles",
        game=Game((player,), DOUBLE_INTEGRATOR, horizon=3, dt=1.0),
        weights=np.ones((1, 2)),
        initial_state=np.array([[0.0, 0.0, 1.0, 0.0]]),
        limits=Limits(controls=(1.0, 1.0), states=(10.0, 10.0, 10.0, 10.0)),
    )


def assert_usable(world):
    observations, _ = world.reset(seed=0)
    assert set(observations) == set(world.agents)
    world.step({p: np.zeros(2) for p in world.agents})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"scenario": "three_player"}, "unknown scenario 'three_player'.*two_player"),
        ({"scenario": 3}, "unknown scenario 3; known are"),
        ({"scenario": "random", "num_player": 3}, "no option 'num_player'.*num_players"),
        ({"max_cycles": 0}, "max_cycles must be at least 1, got 0"),
        ({"render_mode": "ansi"}, "unknown render_mode 'ansi'.*human, rgb_array"),
        ({"scenario": never_settles(), "num_players": 3}, "takes no options, got num_players"),
        (
            {"scenario": Scenario(**{**vars(never_settles()), "limits": None})},
            "'never_settles' has no limits",
        ),
    ],
)
def test_bad_arguments(arguments, message):
    with pytest.raises(ValueError, match=message):
        olne_v0.parallel_env(**arguments)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"scenario": "three_player"}, "unknown scenario 'three_player'.*two_player"),
        ({"scenario": "random", "players": 3}, "no option 'players'.*num_players"),
        ({"num_players": 3}, "'two_player' has no option 'num_players'"),
    ],
)
def test_bad_reset_options_leave_a_usable_world(options, message):
    world = olne_v0.parallel_env("two_player")
    world.reset()
    with pytest.raises(ValueError, match=message):
        world.reset(options=options)
    with pytest.raises(ResetNeeded):
        world.step({p: np.zeros(2) for p in world.possible_agents})
    assert_usable(world)


def test_scenario_without_equilibrium():
    world = olne_v0.parallel_env("two_player")
    with pytest.raises(NoEquilibriumError, match="no certified equilibrium of 'never_settles'"):
        world.reset(options={"scenario": never_settles()})
    assert_usable(world)
    # It can still be played without the truth.
    free = olne_v0.parallel_env(never_settles(), reveal_truth=False)
    assert_usable(free)


def test_a_reset_without_a_seed_draws_until_the_limits_hold(monkeypatch):
    within = olne_v0._equilibrium_within
    asked = []

    def sometimes(scenario, size):
        asked.append(scenario)
        if len(asked) < 3:
            raise NoEquilibriumError("beyond the limits")
        return within(scenario, size)

    monkeypatch.setattr(olne_v0, "_equilibrium_within", sometimes)
    world = olne_v0.parallel_env("two_player")
    world.reset()
    assert len(asked) == 3
    asked.clear()
    with pytest.raises(NoEquilibriumError):
        world.reset(seed=3)


def test_equilibrium_beyond_the_limits():
    two_player = get_scenario("two_player")
    narrow = Scenario(**{**vars(two_player), "limits": Limits((0.3, 0.3), (20.0,) * 4)})
    world = olne_v0.parallel_env(narrow)
    with pytest.raises(NoEquilibriumError, match=r"acceleration of up to 0\.38, beyond.* 0\.3"):
        world.reset()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"player_1": np.array([0.0, np.nan])}, "acceleration of player_1 is nan.*-1.0, 1.0"),
        ({"player_0": np.array([1.5, 0.0])}, "yaw_rate of player_0 is 1.5.*-1.0, 1.0"),
        ({"player_0": np.zeros(3)}, r"player_0 has the shape \(3,\).*yaw_rate, acceleration"),
        ({"player_0": None}, "player_0"),
        ({"player_7": np.zeros(2)}, "unknown player player_7; players are: player_0, player_1"),
    ],
)
def test_bad_actions_move_nothing(change, message):
    world = olne_v0.parallel_env("two_player")
    world.reset()
    before = world.state()
    idle = {player: np.zeros(2) for player in world.agents}
    with pytest.raises(ValueError, match=message):
        world.step(idle | change)
    assert np.array_equal(world.state(), before)
    world.step(idle)
    assert world.state()[-1] == 0.25


def test_calls_out_of_order():
    world = olne_v0.parallel_env("two_player", max_cycles=1)
    idle = {player: np.zeros(2) for player in world.possible_agents}
    for call in (lambda: world.step(idle), world.state, world.render, lambda: world.scenario):
        with pytest.raises(ResetNeeded, match=r"call reset\(\)"):
            call()
    world.reset()
    world.step(idle)
    with pytest.raises(ResetNeeded, match=r"call reset\(\)"):
        world.step(idle)
    with pytest.raises(ValueError, match="unknown player 'player_2'; players are: player_0"):
        world.observation_space("player_2")
    assert world.step({}) == ({}, {}, {}, {}, {})  # no player is left, and nothing happens
    assert_usable(world)


@pytest.mark.parametrize(
    "action", [np.zeros(3), np.array([np.nan, 0.0]), np.array([0.0, 1e3]), None]
)
def test_a_wrong_turn_is_refused_at_once_and_may_be_repeated(action):
    world = olne_v0.env("two_player")
    world.reset()
    with pytest.raises(ValueError, match="player_0"):
        world.step(action)
    assert world.agent_selection == "player_0"
    for player in world.agent_iter():
        _, _, terminated, truncated, info = world.last()
        world.step(None if terminated or truncated else info["olne_action"])
        assert player in ("player_0", "player_1")
    truth = record(get_scenario("two_player"))
    assert np.array_equal(world.state()[:-1].reshape(2, 4), truth.states[-1])
