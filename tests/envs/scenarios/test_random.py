"""Crossing players: properties of every draw."""

import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.scenarios.random import LIMITS, RADIUS_RANGE, SPEED_RANGE, WEIGHT_RANGE
from olne_bench.envs.worlds.scene import goals


def between(angles: np.ndarray) -> np.ndarray:
    """Angles as differences, in (-pi, pi]."""
    return (angles + np.pi) % (2 * np.pi) - np.pi


@pytest.mark.parametrize("players", [1, 2, 3, 6])
def test_starts_goals_and_headings_lie_where_they_should(players: int) -> None:
    spreads = []
    for seed in range(20):
        scenario = get_scenario("random", seed, num_players=players)
        start = scenario.initial_state
        goal = np.array([place for _, place in sorted(goals(scenario).items())])
        for places in (start[:, :2], goal):
            radii = np.linalg.norm(places, axis=1)
            assert RADIUS_RANGE[0] <= radii.min() <= radii.max() <= RADIUS_RANGE[1]
        at, to = (np.arctan2(p[:, 1], p[:, 0]) for p in (start, goal))
        assert np.abs(between(to - at - np.pi)).max() <= np.deg2rad(35) + 1e-12
        way = goal - start[:, :2]
        off = between(start[:, 2] - np.arctan2(way[:, 1], way[:, 0]))
        assert np.abs(off).max() <= np.deg2rad(15) + 1e-12
        assert SPEED_RANGE[0] <= start[:, 3].min() <= start[:, 3].max() <= SPEED_RANGE[1]
        ratios = scenario.weights.min(axis=1) / scenario.weights.max(axis=1)
        assert ratios.min() >= WEIGHT_RANGE[0] / WEIGHT_RANGE[1]
        # Each has its own slot: neighbours are at least half a slot apart.
        if players > 1:
            ordered = np.sort(at % (2 * np.pi))
            gaps = np.diff(np.append(ordered, ordered[0] + 2 * np.pi))
            assert gaps.min() >= np.pi / players - 1e-9
            assert gaps.max() <= 3 * np.pi / players + 1e-9
        spreads.append(off)
    spread = np.concatenate(spreads)
    assert spread.min() < 0 < spread.max()


def test_players_are_two_to_four_where_nobody_says() -> None:
    counts = {get_scenario("random", seed).game.num_players for seed in range(20)}
    assert counts == {2, 3, 4}


def test_states_within_the_limits_are_all_that_controls_reach() -> None:
    game = get_scenario("random", 0).game
    duration = (game.horizon - 1) * game.dt
    yaw_rate, acceleration = LIMITS.controls
    px, py, heading, speed = LIMITS.states
    fastest = SPEED_RANGE[1] + acceleration * duration
    way = RADIUS_RANGE[1] + (SPEED_RANGE[1] + fastest) / 2 * duration
    assert px == py
    for limit, reach in ((speed, fastest), (px, way), (heading, np.pi + yaw_rate * duration)):
        assert 0.95 * reach <= limit <= 1.1 * reach
