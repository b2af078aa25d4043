"""The joint problem with a prior: ``map`` and ``ridge``."""

from dataclasses import replace

import numpy as np
import pytest

from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.map import Map, probable_optima, with_prior
from olne_bench.estimators.protocol import Estimate, Problem
from olne_bench.estimators.ridge import Ridge, flat_variance
from olne_bench.estimators.shared.certainty import posterior_covariance
from olne_bench.estimators.shared.forward_model import SolvedGame, squared_error_of
from olne_bench.estimators.shared.interior_point import solve_joint
from olne_bench.estimators.shared.joint_ipopt import solve_joint_ipopt
from olne_bench.estimators.shared.joint_problem import JointPoint, JointSettings
from olne_bench.estimators.shared.trajectory_fit import guess_states
from olne_bench.games.model.game import Game
from olne_bench.games.model.weight_prior import FLAT, WeightPrior
from olne_bench.games.solve.olne import solve_olne


def estimated(estimator, problem, observation) -> Estimate:
    return estimator.estimate(problem, observation, rng=np.random.default_rng(0), budget=60.0)


def swapped(problem: Problem) -> Problem:
    game = problem.game
    return replace(problem, game=Game(game.players[::-1], game.dynamics, game.horizon, game.dt))


@pytest.mark.parametrize("estimator", [Map(), Ridge()])
@pytest.mark.parametrize("view", ["full", "partial"])
def test_without_noise_it_is_the_maximum_likelihood_estimate(estimator, view, seen) -> None:
    problem, (observation,), weights = seen(view=view)
    found = estimated(estimator, problem, observation)
    assert found.converged
    assert found.covariance is None
    np.testing.assert_allclose(found.weights, weights, atol=1e-6)
    plain = estimated(KktConstrained(), problem, observation)
    np.testing.assert_array_equal(found.weights, plain.weights)


@pytest.mark.parametrize("estimator", [Map(), Map(alpha=3.0), Ridge()])
def test_players_may_be_counted_in_any_order(estimator, seen) -> None:
    problem, (observation,), _ = seen(sigma=0.03)
    found = estimated(estimator, problem, observation)
    turned = replace(observation, y=observation.y[:, ::-1].copy())
    other = estimated(estimator, swapped(problem), turned)
    np.testing.assert_allclose(other.weights[::-1], found.weights, atol=1e-4)


@pytest.mark.parametrize("sigma", [0.01, 0.1])
def test_ipopt_agrees_on_the_optimum(sigma, seen) -> None:
    problem, (observation,), _ = seen(sigma=sigma)
    game, view, y = problem.game, problem.view, observation.y
    settings = with_prior(JointSettings(), problem, FLAT)
    start = JointPoint.from_trajectory(game, guess_states(game, view, y))
    ours = solve_joint(game, view, y, start, settings)
    reference = solve_joint_ipopt(game, view, [y], [start], settings)
    assert ours.converged
    assert reference.converged
    np.testing.assert_allclose(ours.point.weights, reference.point.weights, atol=1e-5)
    assert ours.criterion == pytest.approx(reference.criterion, rel=1e-6)
    assert ours.objective == pytest.approx(reference.objective, rel=1e-5)
    assert ours.objective == pytest.approx(
        squared_error_of(problem, ours.point.states, y), rel=1e-9
    )


def criterion(problem: Problem, y: np.ndarray, states: np.ndarray, weights: np.ndarray) -> float:
    """(M1) by its definition."""
    prior = 2 * problem.sigma**2 * np.sum(np.log(weights - problem.weight_floor))
    return squared_error_of(problem, states, y) - prior


def test_no_point_nearby_is_more_probable(seen) -> None:
    problem, (observation,), _ = seen(sigma=0.1)
    found = estimated(Map(), problem, observation)
    y, rng = observation.y, np.random.default_rng(0)
    best = criterion(problem, y, found.states, found.weights)
    for size in (1e-3, 1e-2, 1e-1):
        for _ in range(6):
            weights = found.weights * np.exp(size * rng.standard_normal(found.weights.shape))
            weights /= weights.sum(axis=1, keepdims=True)
            start = found.states[0] + 0.3 * size * rng.standard_normal(found.states[0].shape)
            game = solve_olne(problem.game, weights, start)
            assert criterion(problem, y, game.states, weights) > best - 1e-9


def test_a_stronger_prior_pulls_harder(seen) -> None:
    problem, (observation,), _ = seen(sigma=0.1)
    away = [
        np.abs(estimated(Map(alpha=alpha), problem, observation).weights - 0.25).max()
        for alpha in (0.1, 1.0, 10.0, 1000.0)
    ]
    assert away == sorted(away, reverse=True)
    assert away[-1] < 0.02
    plain = np.abs(estimated(KktConstrained(), problem, observation).weights - 0.25).max()
    assert away[0] < plain + 1e-6


def test_the_covariance_knows_the_prior(seen) -> None:
    problem, (observation,), _ = seen(sigma=0.003)
    plain, probable = (
        estimated(estimator, problem, observation) for estimator in (KktConstrained(), Map())
    )
    np.testing.assert_allclose(probable.covariance.sum(axis=0), 0, atol=1e-12)
    np.testing.assert_allclose(
        np.diag(probable.covariance), np.diag(plain.covariance), rtol=0.2, atol=1e-6
    )
    noisy = replace(problem, sigma=1e4)
    game = SolvedGame(solve_olne(problem.game, np.ones((2, 4)), plain.states[0]), np.ones((2, 4)))
    flat = np.full((2, 4), 1 / flat_variance(4))
    known = posterior_covariance(noisy, [observation], [game], None, flat)
    np.testing.assert_allclose(np.diag(known), flat_variance(4) * 0.75, rtol=1e-3)


def test_all_optima_are_sorted_by_their_probability(seen) -> None:
    problem, (observation,), _ = seen(sigma=0.1, view="partial")
    optima = probable_optima(problem, observation.y, FLAT, np.inf)
    criteria = [one.criterion for one in optima]
    assert criteria == sorted(criteria)
    best = estimated(Map(), problem, observation)
    assert criteria[0] <= criterion(problem, observation.y, best.states, best.weights) + 1e-9


@pytest.mark.parametrize("estimator", [Map(), Ridge()])
def test_several_trajectories_share_the_prior(estimator, seen) -> None:
    problem, observations, weights = seen(sigma=0.02, count=2)
    found = estimated(estimator, problem, tuple(observations))
    assert found.converged
    assert np.abs(found.weights - weights).max() < 0.2


def test_several_trajectories_say_more_than_one(seen) -> None:
    problem, observations, _ = seen(sigma=0.02, count=2)
    found, one = (
        estimated(Map(), problem, some) for some in (tuple(observations), observations[0])
    )
    assert np.trace(found.covariance) < np.trace(one.covariance)


def test_ridge_claims_no_region(seen) -> None:
    problem, (observation,), _ = seen(sigma=0.03)
    found = estimated(Ridge(), problem, observation)
    assert found.converged and found.covariance is None and found.region is None


def test_a_prior_out_of_range_is_refused() -> None:
    with pytest.raises(ValueError, match="alpha must be a number"):
        Map(alpha=0.0)


def log_posterior(problem: Problem, observation, found: Estimate) -> float:
    """Log of the posterior of an estimate's motion and weights, in log-ratios."""
    free = 1 - problem.game.num_weights * problem.weight_floor
    shares = (found.weights - problem.weight_floor) / free
    error = squared_error_of(problem, found.states, observation.y)
    return float(problem.prior.log_density(shares).sum() - error / (2 * problem.sigma**2))


def test_a_stated_prior_is_that_of_its_parameter(seen) -> None:
    problem, (observation,), _ = seen(sigma=0.1)
    stated = replace(problem, prior=WeightPrior((3.0,)))
    told = estimated(Map(), stated, observation)
    np.testing.assert_array_equal(
        told.weights, estimated(Map(alpha=3.0), problem, observation).weights
    )
    np.testing.assert_array_equal(
        estimated(Map(alpha=3.0), stated, observation).weights, told.weights
    )
    plain = estimated(Map(), problem, observation)
    assert np.abs(told.weights - plain.weights).max() > 1e-3


def test_a_mixture_is_climbed_from_the_distribution_that_matches_it(seen) -> None:
    problem, (observation,), _ = seen(sigma=0.3)
    mixture = WeightPrior(((20.0, 4.0, 4.0, 4.0), (4.0, 4.0, 4.0, 20.0)), (0.4, 0.6))
    problem = replace(problem, prior=mixture)
    found = estimated(Map(), problem, observation)
    assert found.converged
    matched = WeightPrior((tuple(mixture.matched(4)),))
    start = estimated(Map(), replace(problem, prior=matched), observation)
    gain = log_posterior(problem, observation, found) - log_posterior(problem, observation, start)
    assert gain > 0.1
