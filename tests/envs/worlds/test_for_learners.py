"""``highway_v0`` for learners: bounded, ego-relative, and no player leaves early."""

import cloudpickle
import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test

from olne_bench.envs import highway_v0
from olne_bench.envs.roads.highway_roads import ROAD_NAMES
from olne_bench.envs.worlds.for_learners import (
    ACCELERATION,
    BESIDE_LANE,
    DISTANCE,
    OTHER,
    OWN,
    SPEED,
    STEERING,
    ForLearners,
)
from olne_bench.envs.worlds.wrappers import AWGN

ROADS = pytest.mark.parametrize("road", ROAD_NAMES)


def make(road, **arguments):
    return ForLearners(highway_v0.parallel_env(road, reveal_truth=False), **arguments)


def parts(observation):
    """Named own entries, and others (N-1, 7)."""
    own = dict(zip(OWN, observation[: len(OWN)].tolist(), strict=True))
    return own, observation[len(OWN) :].reshape(-1, len(OTHER))


@pytest.mark.parametrize("road", ["highway", "two_way"])  # the others take seconds to draw
def test_pettingzoo_conformance(road):
    parallel_api_test(make(road, draws=1), num_cycles=21)


def test_same_seed_same_episode():
    parallel_seed_test(lambda: make("two_way", draws=2), num_cycles=3)


@ROADS
def test_whoever_drives_the_equilibrium_sees_its_lane_and_finishes(road):
    world = ForLearners(highway_v0.parallel_env(road), draws=1)
    observations, infos = world.reset(seed=0)
    players, largest = world.agents, 0.0
    while world.agents:
        actions = {p: infos[p]["olne_action"] / (STEERING, ACCELERATION) for p in world.agents}
        largest = max(largest, *(np.abs(action).max() for action in actions.values()))
        observations, _, terminations, _, infos = world.step(actions)
        for player in players:
            assert observations[player] in world.observation_space(player)
    assert all(terminations.values()) and not any(infos[p]["crashed"] for p in players)
    if largest <= 1:  # nothing was clipped, so this is the equilibrium
        for observation in observations.values():
            own, _ = parts(observation)
            assert abs(own["beside_lane"]) < 0.5 and own["cos_to_lane"] > 0.8
            assert own["time_left"] == 0


def test_observations_are_relative_to_the_player():
    world = make("highway", draws=1)
    observations, _ = world.reset(seed=0)
    states = world.unwrapped.state()[:-1].reshape(-1, 4)
    own, others = parts(observations["player_1"])
    assert own["speed"] == pytest.approx(states[1, 3] / SPEED)
    assert own["time_left"] == 1
    offsets = np.delete(states, 1, axis=0)[:, :2] - states[1, :2]  # all cars head along x
    offsets = offsets[np.argsort(np.hypot(*offsets.T))]
    expected = np.clip(offsets / DISTANCE, -1, 1)
    np.testing.assert_allclose(others[:, 1:3], expected, atol=1e-6)
    assert (others[:, 0] == 1).all()


def test_observations_do_not_depend_on_where_north_is():
    """A car is turned about the centre of the ring: what it sees of the others is the same."""
    from olne_bench.envs.worlds.for_learners import _others

    rng = np.random.default_rng(0)
    states = rng.normal(size=(4, 4)) * (20, 20, 1, 10)
    cos, sin = np.cos(0.7), np.sin(0.7)
    turned = states.copy()
    turned[:, :2] = states[:, :2] @ np.array([[cos, sin], [-sin, cos]]) + (300, -40)
    turned[:, 2] += 0.7
    np.testing.assert_allclose(
        _others(states[0], states[1:]), _others(turned[0], turned[1:]), atol=1e-12
    )


def test_a_car_beside_its_lane_sees_how_far():
    world = make("highway", draws=1)
    observations, _ = world.reset(seed=0)
    scenario = world.unwrapped.scenario
    for index, player in enumerate(world.agents):
        lane = scenario.game.players[index].task[0].route[0]
        offset = scenario.initial_state[index, 1] - lane.start[1]
        own, _ = parts(observations[player])
        assert own["beside_lane"] == pytest.approx(np.clip(offset / BESIDE_LANE, -1, 1), abs=1e-6)


def test_crashed_players_stay_blind_and_idle():
    """All cars brake except those behind, which run into them."""
    world = make("highway", draws=1, crash_reward=-7.0)
    world.reset(seed=0)
    front = {p for p in world.agents if int(p[-1]) % 2 == 0}
    total, players, crashed = dict.fromkeys(world.agents, 0.0), world.agents, {}
    while world.agents:
        actions = {
            p: np.array([0.0, -1.0 if p in front else 1.0], dtype=np.float32) for p in world.agents
        }
        assert world.agents == players
        before = dict(crashed)
        observations, rewards, terminations, truncations, infos = world.step(actions)
        for player in players:
            if before.get(player):
                assert rewards[player] == 0
                assert infos[player]["crashed"]
                assert not observations[player].any()
            elif infos[player]["crashed"]:
                total[player] += rewards[player]
                crashed[player] = True
        assert len(set(terminations.values())) == 1
    assert 0 < len(crashed) < len(players)
    assert all(terminations.values()) and not any(truncations.values())


def test_a_crash_costs_once():
    """The same drive, with and without the reward of a crash."""
    returns = []
    for crash_reward in (0.0, -50.0):
        world = make("highway", draws=1, crash_reward=crash_reward)
        world.reset(seed=0)
        total = dict.fromkeys(world.agents, 0.0)
        while world.agents:
            action = np.array([1.0, 1.0], dtype=np.float32)  # into the car beside it
            _, rewards, _, _, infos = world.step(dict.fromkeys(world.agents, action))
            total = {player: total[player] + rewards[player] for player in total}
        returns.append(total)
        crashed = {player for player in total if infos[player]["crashed"]}
    for player in total:
        difference = returns[1][player] - returns[0][player]
        assert difference == pytest.approx(-50.0 if player in crashed else 0.0, abs=1e-9)


def test_max_cycles_truncates_everybody():
    world = ForLearners(highway_v0.parallel_env("merge", reveal_truth=False, max_cycles=2), draws=1)
    world.reset(seed=0)
    idle = dict.fromkeys(world.agents, np.zeros(2, dtype=np.float32))
    world.step(idle)
    _, _, terminations, truncations, _ = world.step(idle)
    assert all(truncations.values()) and not any(terminations.values())
    assert world.agents == []


def test_draws_are_few_and_copies_choose_for_themselves():
    world = make("two_way", draws=2)
    copies = [cloudpickle.loads(cloudpickle.dumps(world)) for _ in range(2)]
    seen = {i: [] for i in range(2)}
    for _ in range(12):
        for i, copy in enumerate(copies):
            copy.reset()
            seen[i].append(copy.unwrapped.state()[4])
    assert len({*seen[0], *seen[1]}) == 2
    assert seen[0] != seen[1]  # by chance equal once in 4096


@pytest.mark.parametrize(
    ("wrap", "message"),
    [
        (lambda world: ForLearners(AWGN(world, 0.1)), "right around a world .* got AWGN"),
        (lambda world: ForLearners(world, draws=0), "draws must be at least 1, got 0"),
    ],
)
def test_bad_arguments(wrap, message):
    with pytest.raises(ValueError, match=message):
        wrap(highway_v0.parallel_env("merge", reveal_truth=False))


def test_unknown_players_are_named():
    world = make("merge", draws=1)
    world.reset(seed=0)
    with pytest.raises(ValueError, match="unknown player player_9"):
        world.step(dict.fromkeys([*world.agents, "player_9"], np.zeros(2)))
