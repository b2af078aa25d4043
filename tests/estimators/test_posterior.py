"""Samples of the posterior."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from olne_bench.bench.judge.estimate_check import check_estimate
from olne_bench.bench.judge.raw_estimate import read_estimate
from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.posterior import Posterior
from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.estimators.shared.forward_model import (
    SolvedGame,
    expected_samples,
    sample_sensitivity,
    scaled_samples,
)
from olne_bench.games.model.costs import ControlEffort, FinalGoal, Proximity
from olne_bench.games.model.dynamics import UNICYCLE
from olne_bench.games.model.game import Game, Player
from olne_bench.games.model.observation import VIEWS, observe
from olne_bench.games.solve.olne import solve_olne

QUICK = Posterior(first=200, more=100, most=800, enough=400, count=800)


def estimated(estimator, problem, observation, budget: float = 60.0) -> Estimate:
    return estimator.estimate(problem, observation, rng=np.random.default_rng(0), budget=budget)


@pytest.mark.parametrize("view", ["full", "partial"])
def test_without_noise_it_is_the_truth(view, seen) -> None:
    problem, (observation,), weights = seen(view=view)
    found = estimated(QUICK, problem, observation)
    assert found.converged, found.message
    np.testing.assert_allclose(found.weights, weights, atol=5e-3)
    assert found.samples.std(axis=0).max() < 0.02


def test_samples_pass_the_referee(seen) -> None:
    problem, (observation,), _ = seen(sigma=0.01)
    found = estimated(QUICK, problem, observation)
    assert found.converged, found.message
    checked = check_estimate(read_estimate(found), problem)
    assert checked.samples.shape == (800, 2, 4)
    assert checked.parameter_samples is None
    np.testing.assert_allclose(checked.samples, found.samples, rtol=1e-12)
    np.testing.assert_allclose(found.samples.mean(axis=0), found.weights, atol=0.03)
    flat = found.samples.reshape(800, -1)
    np.testing.assert_allclose(np.cov(flat.T), found.covariance, atol=0.01)
    assert found.extras["effective_sample_size"] >= 400
    again = estimated(QUICK, problem, observation)
    np.testing.assert_array_equal(again.samples, found.samples)


def test_players_may_be_counted_in_any_order(seen) -> None:
    problem, (observation,), _ = seen(sigma=0.03)
    game = problem.game
    other = replace(problem, game=Game(game.players[::-1], game.dynamics, game.horizon, game.dt))
    turned = Observation(observation.y[:, ::-1].copy())
    one = estimated(QUICK, problem, observation)
    two = estimated(QUICK, other, turned)
    deviations = np.sqrt(np.diag(one.covariance)).reshape(2, 4)
    assert (np.abs(two.weights[::-1] - one.weights) < 0.2 * deviations + 1e-3).all()


def test_what_motion_does_not_show_keeps_its_prior(seen) -> None:
    """Of three samples, only the controls of two steps are known, and those roughly."""
    problem, (observation,), _ = seen(sigma=0.3)
    y = observation.y.copy()
    y[3:] = np.nan
    found = estimated(replace(QUICK, most=400), problem, Observation(y))
    assert found.samples is not None, found.message
    np.testing.assert_allclose(found.weights, 0.25, atol=0.1)
    variances = np.diag(found.covariance)
    assert (variances > 0.0375 / 2).all() and (variances < 0.0375 * 2).all()


@cache
def _tiny() -> tuple[Problem, Observation, SolvedGame]:
    """Two players with two weights each, nearly straight ahead, and their motion in noise."""
    players = tuple(
        Player(
            preferences=(Proximity(), ControlEffort("acceleration", scale=10.0)),
            task=(FinalGoal(goal), ControlEffort("yaw_rate")),
        )
        for goal in ((1.0, 0.0), (0.0, 1.0))
    )
    game = Game(players, UNICYCLE, 10, 0.5)
    weights = np.array([[0.3, 0.7], [0.6, 0.4]])
    start = np.array([[-1.0, 0.0, 0.15, 0.3], [0.0, -1.0, 1.72, 0.3]])
    truth = solve_olne(game, weights, start)
    sigma = 0.02
    noisy = truth.states + sigma * np.random.default_rng(3).standard_normal(truth.states.shape)
    y = observe(VIEWS["full"], game.dynamics, noisy)
    return Problem(game, VIEWS["full"], sigma), Observation(y), SolvedGame(truth, weights)


def _log_marginal(weights: np.ndarray) -> float:
    """Log-density of weights with x_1 integrated out by Laplace at its conditional optimum."""
    problem, observation, known = _tiny()
    samples, start = scaled_samples(problem, observation.y), known.root.states[0].copy()
    for _ in range(3):
        root = solve_olne(problem.game, weights, start, initial_controls=known.root.controls)
        game = SolvedGame(root, weights)
        by_start = sample_sensitivity(problem, game)[:, weights.size :] / problem.sigma
        errors = (expected_samples(problem, root.states) - samples).ravel() / problem.sigma
        information = by_start.T @ by_start
        start = start - np.linalg.solve(information, by_start.T @ errors).reshape(start.shape)
    return float(-errors @ errors / 2 - np.linalg.slogdet(information)[1] / 2)


def test_it_agrees_with_a_grid() -> None:
    problem, observation, _ = _tiny()
    found = estimated(QUICK, problem, observation)
    assert found.converged, found.message
    means, deviations = found.samples[:, :, 0].mean(axis=0), found.samples[:, :, 0].std(axis=0)
    steps = np.linspace(-3.5, 3.5, 13)
    places = means[:, None] + deviations[:, None] * steps
    logs = np.array(
        [[_log_marginal(np.array([[a, 1 - a], [b, 1 - b]])) for b in places[1]] for a in places[0]]
    )
    density = np.exp(logs - logs.max())
    density /= density.sum()
    for axis in (1, 0):
        marginal = density.sum(axis=axis)
        mean = marginal @ steps
        assert mean == pytest.approx(0.0, abs=0.15)  # in standard deviations of the samples
        assert np.sqrt(marginal @ (steps - mean) ** 2) == pytest.approx(1.0, abs=0.12)


def test_unknown_goals_are_sampled_as_well() -> None:
    scenario = get_scenario("unknown_goals", 0)
    truth = solve_olne(scenario.game, scenario.weights, scenario.initial_state)
    y = observe(VIEWS["full"], scenario.game.dynamics, truth.states)
    y = y + 0.02 * np.random.default_rng(0).standard_normal(y.shape)
    problem = Problem(scenario.told, VIEWS["full"], 0.02)
    found = estimated(QUICK, problem, Observation(y))
    assert found.samples is not None, found.message
    checked = check_estimate(read_estimate(found), problem)
    assert checked.parameter_samples.shape == (800, 2, 2)
    errors = (checked.parameters - scenario.parameters) / checked.parameter_deviations
    assert np.abs(errors).max() < 4


def test_what_cannot_be_sampled_is_said(seen) -> None:
    problem, (observation,), _ = seen(sigma=0.03)
    y = observation.y.copy()
    y[:, 1] = np.nan
    lost = estimated(QUICK, problem, Observation(y))
    assert not lost.converged
    assert lost.message == "never seen, hence not identified: player 1"
    late = estimated(QUICK, problem, observation, budget=0.0)
    assert late.message
    few = estimated(Posterior(first=40, most=40), problem, observation)
    assert few.converged
    assert few.samples is not None
    assert few.message.startswith("the samples are wider than the posterior: it has ")
    assert few.extras["power"] < 1


@pytest.mark.parametrize(
    "wrong",
    [
        {"alpha": 0},
        {"first": 10},
        {"more": 0},
        {"most": 10},
        {"enough": 0},
        {"count": 39},
        {"count": 5000},
    ],
)
def test_parameters_out_of_range_are_refused(wrong) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Posterior(**wrong)
