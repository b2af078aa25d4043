"""The paper's scenarios are the published ones."""

import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.games.model.costs import ControlEffort, FinalGoal, Proximity, StateDeviation


def test_two_players_cross_at_a_right_angle() -> None:
    scenario = get_scenario("two_player")
    game = scenario.game
    assert (game.horizon, game.dt, game.num_players) == (25, 0.25, 2)
    np.testing.assert_allclose(scenario.weights, 0.25)
    px, py, heading, speed = scenario.initial_state.T
    np.testing.assert_allclose(np.hypot(px, py), 1)
    np.testing.assert_allclose(speed, 0.1)
    goals = []
    for player, start in zip(game.players, scenario.initial_state, strict=True):
        (goal,) = player.task
        assert isinstance(goal, FinalGoal)
        np.testing.assert_allclose(goal.goal, -start[:2], atol=1e-12)
        goals.append(goal.goal)
        assert player.preferences == (
            Proximity(0.1, 0.1),
            StateDeviation("speed", 0.0, 1.0),
            ControlEffort("acceleration", 10.0),
            ControlEffort("yaw_rate", 1.0),
        )
    np.testing.assert_allclose(goals, [[1, 0], [0, 1]], atol=1e-12)
    np.testing.assert_allclose(np.rad2deg(heading), [10, 100])
    assert scenario.limits is not None
    # Controls that a world accepts, and states that they can reach.
    assert scenario.limits.controls == (1.0, 1.0)
    reach = 24 * 0.25
    assert reach**2 / 2 + 1.6 < scenario.limits.states[0] == scenario.limits.states[1] < 1.1 * 19.6
    assert np.deg2rad(100) + reach < scenario.limits.states[2] < 8.5
    assert 0.1 + reach < scenario.limits.states[3] < 7.5


def test_noise_scales_are_positive_and_one_per_component() -> None:
    known = get_scenario("two_player")
    assert known.noise_scale == (1.0,) * 4

    def scaled(*scale: float) -> Scenario:
        return Scenario("a", known.game, known.weights, known.initial_state, noise_scale=scale)

    assert scaled(1, 2, 0.1, 3).noise_scale == (1.0, 2.0, 0.1, 3.0)
    for wrong in ((1.0,), (1.0, 1.0, 1.0, 0.0), (1.0, 1.0, 1.0, np.nan), (1.0, 1.0, np.inf, 1.0)):
        with pytest.raises(ValueError, match="must hold 4 positive numbers, one for each of px"):
            scaled(*wrong)


#: px, py, speed, px of the lane, target speed, weight of the proximity.
PUBLISHED = np.array(
    [
        [1, 0, 0.2, 0, 0.3, 0.3],
        [0, -3, 0.4, 0, 0.4, 0.3],
        [1, 2, 0.1, 1, 0.1, 0.05],
        [1, 4, 0.1, 1, 0.1, 0.05],
        [0, 6, 0.3, 1, 0.2, 0.3],
    ]
)


def test_the_scenario_is_that_of_the_publication() -> None:
    scenario = get_scenario("highway_overtaking")
    game = scenario.game
    assert (game.horizon, game.dt, game.num_players) == (20, 1.0, 5)
    states = scenario.initial_state
    np.testing.assert_array_equal(states[:, [0, 1, 3]], PUBLISHED[:, :3])
    np.testing.assert_allclose(states[:, 2], np.pi / 2)
    weights = np.column_stack([PUBLISHED[:, 5], np.ones((5, 3))])
    scaled = weights / weights.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(scenario.weights, scaled)
    for player, (_, _, _, lane, speed, _) in zip(game.players, PUBLISHED, strict=True):
        assert player.preferences == (
            Proximity(0.1, 0.1),
            StateDeviation("speed", target=speed),
            ControlEffort("acceleration", scale=10.0),
            ControlEffort("yaw_rate", scale=1.0),
        )
        assert player.task == (
            StateDeviation("px", target=lane, scale=1.0),
            StateDeviation("heading", target=np.pi / 2, scale=2.0),
        )
