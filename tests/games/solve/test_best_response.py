"""Best responses by Newton's method of one player, against IPOPT and against the definition."""

import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.games.compiled.elimination import elimination
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.game import Game
from olne_bench.games.solve.best_response import best_responses, iterated_best_response
from olne_bench.games.solve.constrained_response import constrained_response
from olne_bench.games.solve.kkt import kkt_system
from olne_bench.games.solve.newton import rows
from olne_bench.games.solve.olne import Equilibrium, solve_olne

Crossing = tuple[Game, np.ndarray, np.ndarray]
NAMES = {"two_player": None, "random": 3, "two_way": 0}


@pytest.fixture(scope="module", params=NAMES)
def played(request: pytest.FixtureRequest):
    """A scenario and its equilibrium."""
    scenario = get_scenario(request.param, NAMES[request.param])
    return scenario, solve_olne(scenario.game, scenario.weights, scenario.initial_state)


def test_costs_are_those_of_the_stacked_system(played) -> None:
    scenario, found = played
    game, theta = scenario.game, scenario.weights.ravel()
    z = rows(game, found.states, found.controls, found.costates)
    function = kkt_system(game).cost_function
    wanted = np.array(function(found.states.ravel(), found.controls.ravel(), theta)).ravel()
    np.testing.assert_allclose(elimination(game).costs(z, theta), wanted, rtol=1e-12)


def deviating(scenario, found, player: int, plan: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """States and controls where one player follows a plan of its own."""
    game, controls, states = scenario.game, found.controls.copy(), found.states.copy()
    controls[:, player] = plan
    rolled = rollout(game.dynamics, found.states[0], controls, game.dt)
    states[:, player] = rolled[:, player]
    return states, controls


def test_near_responses_end_at_the_equilibrium(played) -> None:
    scenario, found = played
    rng = np.random.default_rng(0)
    for player in range(scenario.game.num_players):
        own = found.controls[:, player]
        plans = own + 1e-3 * rng.standard_normal((3, *own.shape))
        arguments = found.states, found.controls, scenario.weights
        result = best_responses(scenario.game, player, plans, *arguments)
        assert result.converged.all() and result.iterations.max() < 20
        np.testing.assert_allclose(result.costs, found.certificate.costs[player], rtol=1e-9)
        for controls, costates in zip(result.controls, result.costates, strict=True):
            np.testing.assert_allclose(controls, own, atol=1e-4)
            np.testing.assert_allclose(costates, found.costates[:, player], atol=1e-2)


def test_far_responses_are_stationary_feasible_and_no_worse_than_their_plans(played) -> None:
    scenario, found = played
    game, theta = scenario.game, scenario.weights.ravel()
    solver = elimination(game)
    for player in range(game.num_players):
        plan = 0.5 * found.controls[::-1, player]
        states, controls = deviating(scenario, found, player, plan)
        z = rows(game, states, controls, found.costates)
        result = best_responses(game, player, plan[None], states, controls, scenario.weights)
        if not result.converged[0]:
            continue
        assert result.costs[0] <= solver.costs(z, theta)[player]
        states, controls = deviating(scenario, found, player, result.controls[0])
        z = rows(game, states, controls, found.costates)
        assert solver.costs(z, theta)[player] == pytest.approx(result.costs[0], rel=1e-12)
        own = result.controls[0], scenario.weights[player]
        again = constrained_response(game, player, states, controls, *own)
        assert again.cost >= result.costs[0] - 1e-7 * (1 + abs(result.costs[0]))


def test_answers_an_equilibrium_with_itself(crossing: Crossing, olne: Equilibrium) -> None:
    game, weights, _ = crossing
    for i in range(game.num_players):
        own = olne.controls[:, i], weights[i]
        response = constrained_response(game, i, olne.states, olne.controls, *own)
        assert response.converged
        np.testing.assert_allclose(response.states, olne.states[:, i], atol=1e-7)
        np.testing.assert_allclose(response.controls, olne.controls[:, i], atol=1e-6)
        assert abs(response.cost - olne.certificate.costs[i]) < 1e-10


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
