import numpy as np

from envs.scenarios import get_scenario
from games.game import Game
from games.kkt import kkt_residual_norm
from games.nearest_root import nearest_root
from games.olne import Equilibrium, solve_olne

Crossing = tuple[Game, np.ndarray, np.ndarray]


def test_true_weights_give_the_truth(crossing: Crossing, crossing_equilibrium: Equilibrium) -> None:
    game, weights, _ = crossing
    found = crossing_equilibrium
    root = nearest_root(game, weights, found.states, found.controls)
    assert root is not None
    np.testing.assert_allclose(root.states, found.states, atol=1e-7)


def test_other_weights_give_their_own_root(
    crossing: Crossing, crossing_equilibrium: Equilibrium
) -> None:
    game, weights, initial_state = crossing
    other = game.check_weights(weights + 0.05 * np.eye(3, 4))
    root = nearest_root(game, other, crossing_equilibrium.states, crossing_equilibrium.controls)
    assert root is not None
    assert kkt_residual_norm(game, root.states, root.controls, root.costates, other) < 1e-6
    np.testing.assert_array_equal(root.states[0], initial_state)
    expected = solve_olne(game, other, initial_state)
    np.testing.assert_allclose(root.states, expected.states, atol=1e-5)
    assert np.abs(root.states - crossing_equilibrium.states).max() > 1e-4


def test_no_root_is_said_so() -> None:
    """An estimate of the kind that the paper calls ill-conditioned: acceleration comes free."""
    scenario = get_scenario("two_player")
    truth = solve_olne(scenario.game, scenario.weights, scenario.initial_state)
    weights = np.array([[0.5015, 0.236, 1e-5, 0.2625], [0.6549, 0.0053, 0.0021, 0.3378]])
    weights = scenario.game.check_weights(weights)
    assert nearest_root(scenario.game, weights, truth.states, truth.controls) is None
