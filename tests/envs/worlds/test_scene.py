"""What pictures of a scenario show besides its motion."""

import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.worlds.scene import goals, heading_of, lanes


def test_goals_are_those_of_the_players() -> None:
    scenario = get_scenario("two_player")
    found = goals(scenario)
    assert sorted(found) == [0, 1]
    # Both cross: each goal is on the other side of the centre.
    for i, goal in found.items():
        assert goal.shape == (2,)
        assert np.linalg.norm(goal - scenario.initial_state[i, :2]) > 1
    assert goals(get_scenario("highway_overtaking")) == {}


def test_lanes_are_listed_once_and_in_order() -> None:
    found = lanes(get_scenario("highway_overtaking"))
    assert len(found) > 1
    assert found == sorted(set(found))
    assert lanes(get_scenario("two_player")) == []


def test_a_vehicle_points_where_its_heading_or_velocity_does() -> None:
    state = np.array([1.0, 2.0, -3.0, 3.0])
    assert heading_of(state, ("px", "py", "heading", "speed")) == -3.0
    assert heading_of(state, ("px", "py", "vx", "vy")) == pytest.approx(0.75 * np.pi)
    assert heading_of(state[:2], ("px", "py")) == 0.0
