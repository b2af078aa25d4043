"""The maximum-entropy residual method: exact derivatives, its optimum, what noise does to it."""

import casadi as ca
import numpy as np
import pytest

from olne_bench.envs.recordings.recording import record
from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.maxent_residual import (
    Curvature,
    MaxentResidual,
    _maximise,
    curvature_along,
    likelihood,
    packed,
)
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.game import Game
from olne_bench.games.model.observation import VIEWS, observe
from olne_bench.games.solve.kkt import kkt_system

RNG = np.random.default_rng(0)


def estimate(problem, observation):
    return MaxentResidual().estimate(problem, observation, rng=RNG, budget=60)


def random_curvature(seed, size=6, count=4):
    rng = np.random.default_rng(seed)
    factors = rng.standard_normal((count, size, size))
    hessians = factors @ factors.transpose(0, 2, 1)
    return Curvature(rng.standard_normal((size, count)), hessians)


@pytest.mark.parametrize("seed", [1, 2])
def test_derivatives_are_those_of_finite_differences(seen, seed):
    problem, _, weights = seen(seed, players=2)
    game, rng = problem.game, np.random.default_rng(seed)
    start = get_scenario("random", seed, num_players=2).initial_state
    controls = 0.1 * rng.standard_normal(game.control_shape)
    states = rollout(game.dynamics, start, controls, game.dt)
    size = controls[:, 0].size

    def cost(player, change):
        moved = controls.copy()
        moved[:, player] += change.reshape(moved[:, player].shape)
        path = rollout(game.dynamics, start, moved, game.dt)
        costs = kkt_system(game).cost_function(path.ravel(), moved.ravel(), weights.ravel())
        return float(costs[player])

    for player, own in enumerate(curvature_along(game, states, controls)):
        gradient = own.gradients @ weights[player]
        hessian = np.tensordot(weights[player], own.hessians, axes=1)
        np.testing.assert_allclose(hessian, hessian.T, atol=1e-10 * np.abs(hessian).max())
        for direction in rng.standard_normal((5, size)):
            ahead, here, behind = (cost(player, s * 1e-4 * direction) for s in (1, 0, -1))
            first, second = (ahead - behind) / 2e-4, (ahead - 2 * here + behind) / 1e-8
            assert gradient @ direction == pytest.approx(first, rel=1e-5, abs=1e-6)
            assert direction @ hessian @ direction == pytest.approx(second, rel=1e-4, abs=1e-4)


def test_the_likelihood_is_that_of_its_formula_and_so_is_its_gradient():
    own, theta = random_curvature(0), np.array([0.4, 0.3, 0.2, 0.1])
    function, values = likelihood(6, 4), packed(own.gradients, own.hessians)
    symbol = ca.MX.sym("theta", 4)
    gradient = ca.Function("d", [symbol], [ca.gradient(function(symbol, values), symbol)])

    def formula(theta):
        g, hessian = own.gradients @ theta, np.tensordot(theta, own.hessians, axes=1)
        return -g @ np.linalg.solve(hessian, g) / 2 + np.linalg.slogdet(hessian)[1] / 2

    assert float(function(theta, values)) == pytest.approx(formula(theta))
    numeric = [(formula(theta + 1e-6 * e) - formula(theta - 1e-6 * e)) / 2e-6 for e in np.eye(4)]
    np.testing.assert_allclose(np.array(gradient(theta)).ravel(), numeric, atol=1e-6)


def test_the_likelihood_is_undefined_where_the_hessian_is_indefinite():
    own = random_curvature(0)
    values = packed(own.gradients, own.hessians - 50 * np.eye(6))
    assert np.isnan(float(likelihood(6, 4)(np.full(4, 0.25), values)))


@pytest.mark.parametrize("seed", range(5))
def test_the_optimum_is_the_best_of_the_simplex(seed):
    """(X4) at the best scale, -n/2 log q + 1/2 log det H, over many weights."""
    own, rng = random_curvature(seed), np.random.default_rng(seed)

    def profile(theta):
        g, hessian = own.gradients @ theta, np.tensordot(theta, own.hessians, axes=1)
        return -3 * np.log(g @ np.linalg.solve(hessian, g)) + np.linalg.slogdet(hessian)[1] / 2

    best = _maximise([own], np.full(4, 0.25), 1e-5)
    assert not best.message
    others = 1e-5 + (1 - 4e-5) * rng.dirichlet(np.ones(4), 5000)
    assert profile(best.weights) > max(profile(theta) for theta in others) - 1e-6
    constant = 3 * np.log(6 / (2 * np.pi)) - 3
    assert best.log_likelihood == pytest.approx(profile(best.weights) + constant, abs=1e-4)


@pytest.mark.parametrize("seed", range(3))
def test_units_of_cost_and_order_of_preferences_do_not_matter(seed):
    own, guess = random_curvature(seed), np.array([0.1, 0.2, 0.3, 0.4])
    weights = _maximise([own], guess, 1e-5).weights
    scaled = Curvature(1e3 * own.gradients, 1e3 * own.hessians)
    np.testing.assert_allclose(_maximise([scaled], guess, 1e-5).weights, weights, atol=1e-6)
    order = np.array([2, 0, 3, 1])
    turned = Curvature(own.gradients[:, order], own.hessians[order])
    turned_weights = _maximise([turned], guess[order], 1e-5).weights
    np.testing.assert_allclose(turned_weights, weights[order], atol=1e-6)


def test_the_order_of_players_does_not_matter(seen):
    problem, (observation,), _ = seen(1, sigma=0.01)
    game = problem.game
    turned = Game(game.players[::-1], game.dynamics, game.horizon, game.dt)
    weights = estimate(problem, observation).weights
    other = estimate(Problem(turned, problem.view, 0.01), Observation(observation.y[:, ::-1]))
    np.testing.assert_allclose(other.weights[::-1], weights, atol=1e-4)


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_noise_free_weights_are_recovered(seen, seed):
    problem, (observation,), weights = seen(seed)
    result = estimate(problem, observation)
    assert result.converged, result.message
    assert not result.extras["regularisation"].any()
    np.testing.assert_allclose(result.weights, weights, atol=1e-4)


def test_the_motion_that_it_believes_in_is_the_filtered_one(seen):
    problem, observations, _ = seen(count=2)
    result = estimate(problem, observations)  # without noise, the first that was observed
    np.testing.assert_allclose(result.states, observations[0].y, atol=1e-5)


def test_without_speeds_one_more_sample_is_needed():
    """Otherwise the last control affects only the last speed, which is not observed."""
    recording = record(get_scenario("random", 1, num_players=2))
    scenario = recording.scenario
    problem = Problem(scenario.game, VIEWS["partial"])
    y, extra = (
        observe(problem.view, scenario.game.dynamics, states)
        for states in (recording.states, recording.extra_state)
    )
    result = estimate(problem, Observation(y, extra))
    np.testing.assert_allclose(result.weights, scenario.weights, atol=1e-4)
    without = estimate(problem, Observation(y))
    assert np.abs(without.weights - scenario.weights).max() > 0.01


def test_at_a_fixed_temperature_they_would_not_be():
    """At the truth g is zero, and what is left of the gradient is not normal to the simplex."""
    scenario = get_scenario("random", 1, num_players=2)
    truth = record(scenario)
    for own, theta in zip(
        curvature_along(scenario.game, truth.states, truth.controls), scenario.weights, strict=True
    ):
        assert np.abs(own.gradients @ theta).max() < 1e-8
        inverse = np.linalg.inv(np.tensordot(theta, own.hessians, axes=1))
        slope = np.einsum("ij,kji->k", inverse, own.hessians) / 2
        assert np.ptp(slope) > 0.1 * np.abs(slope).max()
        assert theta @ slope == pytest.approx(len(inverse) / 2)  # -n / 2c, along the ray, is (X4)


def test_several_trajectories_add_up(seen):
    problem, observations, _ = seen(1, sigma=0.02, count=2)
    one = estimate(problem, observations[0])
    twice = estimate(problem, [observations[0]] * 2)
    both = estimate(problem, observations)
    np.testing.assert_allclose(twice.weights, one.weights, atol=1e-5)
    total = 2 * one.extras["log_likelihood"]
    assert twice.extras["log_likelihood"] == pytest.approx(total, rel=1e-6)
    assert np.abs(both.weights - one.weights).max() > 1e-3
    assert both.converged


def test_an_indefinite_hessian_is_regularised():
    recording = record(get_scenario("two_player"))
    noise = 0.1 * np.random.default_rng(0).standard_normal(recording.states.shape)
    problem = Problem(recording.scenario.game, VIEWS["full"], 0.1)
    regularised = []
    for scale in (0.0, 1.0, 2.0, 3.0):
        result = estimate(problem, Observation(recording.states + scale * noise))
        assert result.converged, result.message
        regularised.append(result.extras["regularisation"].max())
    assert regularised[0] == 0
    assert regularised[-1] > 0
