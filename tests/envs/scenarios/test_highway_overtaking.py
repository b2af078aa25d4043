"""The published overtaking scenario, number by number."""

import numpy as np

from olne_bench.envs.scenarios import get_scenario
from olne_bench.games.model.costs import ControlEffort, Proximity, StateDeviation

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
