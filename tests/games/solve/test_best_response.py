import numpy as np

from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.game import Game
from olne_bench.games.solve.best_response import iterated_best_response
from olne_bench.games.solve.constrained_response import constrained_response
from olne_bench.games.solve.olne import Equilibrium

Crossing = tuple[Game, np.ndarray, np.ndarray]


def test_answers_an_equilibrium_with_itself(
    crossing: Crossing, crossing_equilibrium: Equilibrium
) -> None:
    game, weights, _ = crossing
    found = crossing_equilibrium
    for i in range(game.num_players):
        own = found.controls[:, i], weights[i]
        response = constrained_response(game, i, found.states, found.controls, *own)
        assert response.converged
        np.testing.assert_allclose(response.states, found.states[:, i], atol=1e-7)
        np.testing.assert_allclose(response.controls, found.controls[:, i], atol=1e-6)
        assert abs(response.cost - found.certificate.costs[i]) < 1e-10


def test_iterations_of_best_responses_are_kept_within_their_budget(crossing: Crossing) -> None:
    game, weights, initial_state = crossing
    controls = np.zeros(game.control_shape)
    once = iterated_best_response(game, weights, initial_state, controls, max_rounds=1)
    short = iterated_best_response(game, weights, initial_state, controls, max_iterations=1)
    long = iterated_best_response(game, weights, initial_state, controls)
    np.testing.assert_array_equal(short.controls, once.controls)
    assert not np.array_equal(long.controls, once.controls)


def test_a_native_round_is_each_player_s_best_response_in_turn(crossing: Crossing) -> None:
    """The same round by IPOPT, whichever player begins, at full and at half steps."""
    game, weights, initial_state = crossing
    for first, damping in ((0, 1.0), (1, 0.5)):
        controls = np.zeros(game.control_shape)
        states = rollout(game.dynamics, initial_state, controls, game.dt)
        found = iterated_best_response(
            game, weights, initial_state, controls, max_rounds=1, first=first, damping=damping
        )
        for k in range(game.num_players):
            i = (first + k) % game.num_players
            own = controls[:, i], weights[i]
            response = constrained_response(game, i, states, controls, *own)
            controls[:, i] += damping * (response.controls - controls[:, i])
            states = rollout(game.dynamics, initial_state, controls, game.dt)
        np.testing.assert_allclose(found.controls, controls, atol=1e-5)
        np.testing.assert_allclose(found.states, states, atol=1e-6)
