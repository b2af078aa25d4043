"""The least squared error where weights are held."""

import numpy as np
import pytest
from scipy.special import chdtri

from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.protocol import LIKELIHOOD, Observation, Problem
from olne_bench.estimators.shared.forward_model import SolvedGame, squared_error_of
from olne_bench.estimators.shared.outer_fit import least_error
from olne_bench.games.model.observation import VIEWS, observe
from olne_bench.games.solve.newton import Root
from olne_bench.games.solve.olne import solve_olne

SIGMA = 0.03


@pytest.fixture(scope="module")
def truth() -> SolvedGame:
    scenario = get_scenario("two_player", 3, weights="dirichlet")
    found = solve_olne(scenario.game, scenario.weights, scenario.initial_state)
    return SolvedGame(Root(found.states, found.controls, found.costates, 0.0), scenario.weights)


@pytest.fixture(scope="module")
def problem() -> Problem:
    return Problem(get_scenario("two_player").game, VIEWS["partial"], SIGMA)


def seen(problem: Problem, truth: SolvedGame, seed: int) -> Observation:
    y = observe(problem.view, problem.game.dynamics, truth.root.states)
    return Observation(y + SIGMA * np.random.default_rng(seed).standard_normal(y.shape))


def test_initial_states_are_fitted(problem: Problem, truth: SolvedGame) -> None:
    one = seen(problem, truth, 0)
    least = least_error(problem, (one,), (truth,))
    assert least is not None
    at_truth = squared_error_of(problem, truth.root.states, one.y)
    gained = (at_truth - least) / SIGMA**2  # chi-squared with one degree for each state
    assert 0 < gained < chdtri(8, 1e-4)
    pair = least_error(problem, (one, one), (truth, truth))
    assert pair == pytest.approx(2 * least)


def test_the_likelihood_of_the_truth_is_as_high_as_it_should_be(
    problem: Problem, truth: SolvedGame
) -> None:
    rng, ratios = np.random.default_rng(0), []
    for seed in range(12):
        one = seen(problem, truth, seed)
        estimate = KktConstrained().estimate(problem, one, rng=rng, budget=60)
        assert estimate.region == LIKELIHOOD
        least = least_error(problem, (one,), (truth,))
        assert least is not None
        ratios.append((least - estimate.extras["objective"]) / SIGMA**2)
    assert np.sum(np.array(ratios) < 0) <= 1  # a lower optimum that the estimator missed
    assert 2 < np.mean(ratios) < 10  # six degrees of freedom
    assert np.sum(np.array(ratios) > chdtri(6, 0.05)) <= 3


def test_a_game_that_cannot_be_played_has_no_error(problem: Problem, truth: SolvedGame) -> None:
    lost = SolvedGame(
        Root(truth.root.states + 50, truth.root.controls + 9, truth.root.costates, 1.0),
        truth.weights,
    )
    assert least_error(problem, (seen(problem, truth, 0),), (lost,)) is None
