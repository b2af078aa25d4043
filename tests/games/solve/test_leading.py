"""Plans where the first player leads."""

from dataclasses import replace

import numpy as np
import pytest

import olne_bench as ob
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.game import Game
from olne_bench.games.solve.leading import NoPlanError, led_by_first, response
from olne_bench.games.solve.olne import solve_olne
from olne_bench.games.solve.plan_costs import PlanCosts

Given = tuple[Game, np.ndarray, np.ndarray, np.ndarray]


@pytest.fixture(scope="module")
def three() -> Given:
    """A short game of three: the game, weights, start and open-loop plans."""
    scenario = ob.scenario("random", seed=3, num_players=3)
    game = replace(scenario.game, horizon=8)
    found = solve_olne(game, scenario.weights, scenario.initial_state)
    assert found.certificate.passed
    return game, scenario.weights, scenario.initial_state, found.controls


def followed(given: Given, own: np.ndarray) -> np.ndarray:
    """Others' responses to a leader's plan and to each other, in turn, by the solver of one."""
    game, weights, start, controls = given
    controls = controls.copy()
    controls[:, 0] = own
    for _ in range(60):
        for i in (1, 2):
            states = rollout(game.dynamics, start, controls, game.dt)
            controls[:, i] = response(game, i, controls[:, i], states, controls, weights)
    return controls


def test_nobody_who_follows_gains_by_another_plan(three: Given) -> None:
    game, weights, start, near = three
    led = led_by_first(game, weights, start, near)
    np.testing.assert_allclose(led, followed(three, led[:, 0]), atol=1e-5)


def test_no_plan_nearby_costs_the_leader_less_whatever_others_answer(three: Given) -> None:
    game, weights, start, near = three
    costs, led = PlanCosts(game, weights, start), led_by_first(game, weights, start, near)
    least = costs.at(led).costs[0]
    assert least < costs.at(near).costs[0] - 1e-7
    rng = np.random.default_rng(0)
    for size in (1e-2, 1e-1):
        for away in rng.standard_normal((5, *led[:, 0].shape)):
            for sign in (-1, 1):
                other = followed(three, led[:, 0] + sign * size * away)
                assert costs.at(other).costs[0] > least


def test_plans_move_smoothly_with_weights(three: Given) -> None:
    """Differences of a tenth of the step are a tenth as large: searches end close to (L1)."""
    game, weights, start, near = three
    base = led_by_first(game, weights, start, near)
    away = np.zeros_like(weights)
    away[0, :2] = 1.0, -1.0
    larger, smaller = (
        (led_by_first(game, weights + step * away, start, base) - base) / step
        for step in (1e-4, 1e-5)
    )
    assert np.abs(larger).max() > 1e-3
    np.testing.assert_allclose(larger, smaller, rtol=1e-2, atol=1e-2 * np.abs(larger).max())


def test_plans_that_cannot_be_found_are_said(three: Given) -> None:
    game, weights, start, near = three
    unknown = near.copy()
    unknown[:, 1] = np.nan
    with pytest.raises(NoPlanError, match="do not bend"):
        led_by_first(game, weights, start, unknown)
    states = rollout(game.dynamics, start, near, game.dt)
    with pytest.raises(NoPlanError, match="player 1 finds no response"):
        response(game, 1, near[:, 1], np.full_like(states, np.nan), near, weights)
