"""Cold starts: continuation in the coupling, and the solver of forward games on top of it."""

import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.games.model.costs import ControlEffort, FinalGoal
from olne_bench.games.model.dynamics import UNICYCLE
from olne_bench.games.model.game import Game, Player
from olne_bench.games.solve.continuation import coupled_features, follow_coupling
from olne_bench.games.solve.newton import Root
from olne_bench.games.solve.olne import certify, solve_olne


def test_the_features_that_look_at_others_are_found() -> None:
    scenario = get_scenario("two_player")
    names = np.array(scenario.game.weight_names)
    for row in coupled_features(scenario.game):
        assert list(names[row]) == ["proximity"]
    alone = get_scenario("random", 0, num_players=1)
    assert not coupled_features(alone.game).any()


def test_continuation_reaches_the_equilibrium() -> None:
    scenario = get_scenario("two_player")
    controls = np.zeros(scenario.game.control_shape)
    root = follow_coupling(scenario.game, scenario.weights, scenario.initial_state, controls)
    assert isinstance(root, Root)
    assert certify(scenario.game, root, scenario.weights).passed


def test_continuation_ends_within_its_budget() -> None:
    scenario = get_scenario("random", 3, num_players=6)
    arguments = (
        scenario.game,
        scenario.weights,
        scenario.initial_state,
        np.zeros(scenario.game.control_shape),
    )
    assert follow_coupling(*arguments, max_factorisations=1) is None
    assert follow_coupling(*arguments, limit=0.0) is None


@pytest.mark.parametrize(("players", "seed"), [(2, 18), (3, 8), (4, 4)])
def test_where_continuation_fails_iterated_best_response_serves(players: int, seed: int) -> None:
    """Draws on which continuation alone gave no certified equilibrium when this was written."""
    scenario = get_scenario("random", seed, num_players=players)
    found = solve_olne(scenario.game, scenario.weights, scenario.initial_state)
    assert found.certificate.passed
    assert found.residual < 1e-11


def test_a_game_without_solution_is_no_equilibrium() -> None:
    """Nothing penalises the acceleration: the first-order conditions are singular everywhere."""
    player = Player(preferences=(ControlEffort("yaw_rate"),), task=(FinalGoal((1.0, 0.0)),))
    game = Game((player,), UNICYCLE, horizon=5, dt=0.25)
    found = solve_olne(game, np.ones((1, 1)), np.array([[0.0, 0.0, 0.0, 0.1]]), max_rounds=3)
    assert np.isfinite(found.states).all()
    assert found.certificate.passed is False or found.residual < 1e-9
