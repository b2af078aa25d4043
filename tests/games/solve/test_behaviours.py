"""What players do that do not play the open-loop equilibrium."""

from dataclasses import replace

import numpy as np
import pytest

import olne_bench as ob
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.solve.behaviours import BEHAVIOURS, plans, uncoupled
from olne_bench.games.solve.olne import solve_olne
from olne_bench.games.solve.plan_costs import PlanCosts


@pytest.fixture(scope="module")
def crossing():
    """A short crossing of two players: the game, weights, start and open-loop plans."""
    scenario = ob.scenario("random", seed=1, num_players=2)
    game = replace(scenario.game, horizon=10)
    found = solve_olne(game, scenario.weights, scenario.initial_state)
    assert found.certificate.passed
    return game, scenario.weights, scenario.initial_state, found.controls


@pytest.mark.parametrize("behaviour", [name for name in BEHAVIOURS if name != "straight"])
def test_players_that_do_not_mind_each_other_do_what_they_always_do(crossing, behaviour):
    game, weights, start, _ = crossing
    game = uncoupled(game, 1.0)
    own = solve_olne(game, weights, start).controls
    np.testing.assert_allclose(plans(game, behaviour, weights, start, own), own, atol=1e-5)


def test_one_that_responds_gains_by_no_other_plan(crossing):
    game, weights, start, near = crossing
    others = plans(game, "alone", weights, start, near)
    answered = plans(game, "responding", weights, start, near)
    for player in range(2):
        world = others.copy()
        world[:, player] = answered[:, player]
        at = PlanCosts(game, weights, start).at(world)
        size = near[:, 0].size
        own = at.slopes[player, player * size : (player + 1) * size]
        np.testing.assert_allclose(own, 0, atol=1e-4)


def test_straight_on_changes_no_speed(crossing):
    game, weights, start, near = crossing
    controls = plans(game, "straight", weights, start, near)
    states = rollout(game.dynamics, start, controls, game.dt)
    np.testing.assert_array_equal(
        states[:, :, 2:], np.broadcast_to(start[:, 2:], states[:, :, 2:].shape)
    )


def test_unknown_behaviours_are_refused(crossing):
    game, weights, start, near = crossing
    with pytest.raises(ValueError, match="known are: feedback, responding"):
        plans(game, "shy", weights, start, near)
