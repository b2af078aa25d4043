"""Weights of players that do not play the open-loop equilibrium, and which behaviour they show."""

from dataclasses import replace

import numpy as np
import pytest

import olne_bench as ob
from olne_bench.estimators.behaving import Behaving
from olne_bench.estimators.map import Map
from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.observation import VIEWS, ComponentView, FullView, observe
from olne_bench.games.solve.behaviours import plans
from olne_bench.games.solve.feedback import solve_feedback
from olne_bench.games.solve.olne import solve_olne
from tests.games.solve.test_feedback import linear

SIGMA = 0.003


@pytest.fixture(scope="module")
def seen_of():
    """``seen_of(behaviour, sigma)``: a crossing of two, what is seen of it, and true weights."""
    scenario = ob.scenario("random", seed=1, num_players=2)
    game = replace(scenario.game, horizon=12, dt=2 * scenario.game.dt)
    start, weights = scenario.initial_state, scenario.weights
    near = solve_olne(game, weights, start).controls

    def make(behaviour: str, sigma: float) -> tuple[Problem, Observation, np.ndarray]:
        controls = (
            near if behaviour == "open_loop" else plans(game, behaviour, weights, start, near)
        )
        clean = observe(
            VIEWS["full"], game.dynamics, rollout(game.dynamics, start, controls, game.dt)
        )
        noise = sigma * np.random.default_rng(3).standard_normal(clean.shape)
        return Problem(game, VIEWS["full"], sigma), Observation(clean + noise), weights

    return make


def estimated(estimator, problem, observation) -> Estimate:
    return estimator.estimate(problem, observation, rng=np.random.default_rng(0), budget=60.0)


@pytest.mark.parametrize("behaviour", ["feedback", "responding"])
def test_weights_are_found_again_where_hardly_any_noise_hides_them(seen_of, behaviour):
    problem, observation, weights = seen_of(behaviour, 1e-6)
    found = estimated(Behaving(behaviour), problem, observation)
    np.testing.assert_allclose(found.weights, weights, atol=1e-4)
    plain = estimated(Map(), problem, observation)
    assert np.abs(plain.weights - weights).max() > 10 * np.abs(found.weights - weights).max()


@pytest.mark.parametrize("view", [FullView(), ComponentView("places", ("px", "py"))])
@pytest.mark.parametrize("gap", [False, True])
def test_weights_of_an_lq_game_of_strategies_are_found_again(view, gap):
    """As in Li et al. 2023: all of the state or a part of it, and samples that are missing."""
    game, weights = linear(2), np.array([[0.5, 0.3, 0.2], [0.3, 0.2, 0.5]])
    start = np.random.default_rng(2).normal(size=(2, 4))
    still = np.zeros(game.control_shape)
    motion = solve_feedback(game, weights, start, initial_controls=still).states
    seen = observe(view, game.dynamics, motion).copy()
    seen[2:4] = np.nan if gap else seen[2:4]
    given = Problem(game, view, 1e-6), Observation(seen)
    found = estimated(Behaving("feedback"), *given)
    np.testing.assert_allclose(found.weights, weights, atol=1e-6)
    assert np.abs(estimated(Map(), *given).weights - weights).max() > 0.1


@pytest.mark.parametrize("behaviour", ["open_loop", "responding", "alone", "straight"])
def test_the_behaviour_that_made_the_motion_explains_it_best(seen_of, behaviour):
    problem, observation, _ = seen_of(behaviour, SIGMA / 10)
    table = ob.behaviours(problem, observation)
    assert table.behaviour[0] == behaviour
    assert table.probability.sum() == pytest.approx(1)
    assert table.residual[0] == pytest.approx(SIGMA / 10, rel=0.5)


def test_its_region_is_as_wide_as_that_of_the_posterior(seen_of):
    problem, observation, weights = seen_of("feedback", SIGMA)
    found = estimated(Behaving(), problem, observation)
    assert found.region == "covariance"
    deviations = np.sqrt(np.diag(found.covariance)).reshape(weights.shape)
    assert (np.abs(found.weights - weights) < 4 * deviations + 1e-3).all()


def test_what_cannot_be_asked_is_one_line(seen_of):
    problem, observation, _ = seen_of("open_loop", SIGMA)
    with pytest.raises(ValueError, match="unknown behaviour 'shy'; known are: open_loop, feedback"):
        ob.behaviours(problem, observation, ["shy"])
    with pytest.raises(ValueError, match="behaviour must be one of feedback"):
        Behaving("shy")
    goals = ob.scenario("unknown_goals")
    asked, seen = ob.observe(goals, sigma=0.01)
    assert "no unknown numbers" in Behaving().supports(asked)
    with pytest.raises(ValueError, match="no unknown numbers"):
        ob.behaviours(asked, seen)
