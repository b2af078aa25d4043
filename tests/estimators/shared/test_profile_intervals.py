"""Intervals of single weights from their profile likelihood."""

import time

import numpy as np
import pytest
from scipy.special import chdtri

from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.estimators.shared.forward_model import SolvedGame
from olne_bench.estimators.shared.profile_intervals import OneHeld, profile_intervals
from olne_bench.estimators.shared.trajectory_fit import guess_controls
from olne_bench.games.model.observation import VIEWS, observe
from olne_bench.games.solve.kkt import consistent_costates
from olne_bench.games.solve.newton import newton_root
from olne_bench.games.solve.olne import solve_olne

SIGMA = 0.01
FLOOR = 1e-5


def test_the_chart_holds_one_weight_and_fills_the_rest() -> None:
    start = np.array([[0.2, 0.5, 0.3], [0.6, 0.3, 0.1]])
    chart = OneHeld(start, player=1, weight=0, floor=FLOOR)
    ratios = chart.ratios(start)
    assert ratios.shape == (chart.size,) == (3,)
    np.testing.assert_allclose(chart.weights(ratios), start, atol=1e-12)
    moved = chart.weights(ratios + np.array([0.1, 0.2, 0.3]))
    assert moved[1, 0] == 0.6
    np.testing.assert_allclose(moved.sum(axis=1), 1)
    step = 1e-6
    slopes = [
        (chart.weights(ratios + step * e) - chart.weights(ratios - step * e)).ravel() / (2 * step)
        for e in np.eye(3)
    ]
    np.testing.assert_allclose(chart.jacobian(ratios), np.transpose(slopes), atol=1e-8)


@pytest.fixture(scope="module")
def case() -> tuple[Problem, Observation, SolvedGame, Estimate]:
    scenario = get_scenario("two_player", 2, weights="dirichlet")
    game = scenario.game
    truth = solve_olne(game, scenario.weights, scenario.initial_state)
    problem = Problem(game, VIEWS["full"], SIGMA)
    noise = np.random.default_rng(0).standard_normal(truth.states.shape)
    seen = Observation(observe(problem.view, game.dynamics, truth.states) + SIGMA * noise)
    rng = np.random.default_rng(0)
    found = KktConstrained().estimate(problem, seen, rng=rng, budget=60)
    assert found.states is not None
    controls = guess_controls(game, found.states)
    costates = consistent_costates(game, found.states, controls, found.weights)
    root = newton_root(game, found.states, controls, costates, found.weights)
    return problem, seen, SolvedGame(root, found.weights), found


def deviations(found: Estimate) -> np.ndarray:
    assert found.covariance is not None
    return np.sqrt(np.diag(found.covariance)).reshape(found.weights.shape)


def test_ends_lose_as_much_likelihood_as_they_may(
    case: tuple[Problem, Observation, SolvedGame, Estimate],
) -> None:
    problem, seen, game, found = case
    intervals = profile_intervals(problem, [seen], [game], deviations(found))
    assert np.isfinite(intervals).all()
    low, high = intervals[..., 0], intervals[..., 1]
    assert (low < found.weights).all() and (found.weights < high).all()
    # Where the likelihood is nearly normal, an end is 1.96 standard errors away.
    reach = 1.96 * deviations(found)
    inner = (found.weights - 2 * reach > 0.05) & (reach < 0.05)
    assert inner.any()
    np.testing.assert_allclose((high - found.weights)[inner], reach[inner], rtol=0.25)
    narrow = profile_intervals(problem, [seen], [game], deviations(found), level=0.5)
    assert (narrow[..., 0] > low).all() and (narrow[..., 1] < high).all()
    ratio = (high - low) / (narrow[..., 1] - narrow[..., 0])
    expected = np.sqrt(chdtri(1, 0.05) / chdtri(1, 0.5))
    np.testing.assert_allclose(ratio[inner], expected, rtol=0.15)


def test_the_deadline_leaves_ends_open(
    case: tuple[Problem, Observation, SolvedGame, Estimate],
) -> None:
    problem, seen, game, found = case
    late = time.monotonic() - 1
    intervals = profile_intervals(problem, [seen], [game], deviations(found), deadline=late)
    assert np.isnan(intervals).all()
