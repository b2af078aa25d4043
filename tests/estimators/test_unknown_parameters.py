"""Estimators that find unknown numbers of the game beside the weights."""

import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.bilevel import Bilevel
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.kkt_residual import KktResidual
from olne_bench.estimators.maxent_residual import MaxentResidual
from olne_bench.estimators.particle import Particle
from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.estimators.shared.charts import RatioChart
from olne_bench.estimators.shared.forward_model import first_games
from olne_bench.estimators.shared.outer_fit import OuterResiduals
from olne_bench.estimators.ukf import Ukf
from olne_bench.estimators.uniform import Uniform
from olne_bench.games.model.observation import VIEWS, observe
from olne_bench.games.solve.olne import solve_olne

SCENARIO = get_scenario("unknown_goals", 0)


@pytest.fixture(scope="module")
def states() -> np.ndarray:
    """The true motion (T, N, 4)."""
    return solve_olne(SCENARIO.game, SCENARIO.weights, SCENARIO.initial_state).states


def estimated(
    estimator, states: np.ndarray, *, view: str = "full", sigma: float = 0.0, seed: int = 0
) -> Estimate:
    y = observe(VIEWS[view], SCENARIO.game.dynamics, states)
    y = y + sigma * np.random.default_rng(seed).standard_normal(y.shape)
    problem = Problem(SCENARIO.told, VIEWS[view], sigma)
    return estimator.estimate(problem, Observation(y), rng=np.random.default_rng(0), budget=60.0)


def errors_of(estimate: Estimate) -> np.ndarray:
    """Errors (N, U) of the parameters."""
    assert estimate.parameters is not None
    assert SCENARIO.parameters is not None
    return estimate.parameters - SCENARIO.parameters


@pytest.mark.parametrize("view", ["full", "partial"])
@pytest.mark.parametrize("estimator", [KktConstrained(), Bilevel()])
def test_exact_motion_gives_weights_and_goals(estimator, view, states) -> None:
    estimate = estimated(estimator, states, view=view)
    assert estimate.converged
    np.testing.assert_allclose(estimate.weights, SCENARIO.weights, atol=1e-6)
    assert np.abs(errors_of(estimate)).max() < 1e-6


def test_both_find_the_same_optimum(states) -> None:
    one, other = (
        estimated(estimator, states, view="partial", sigma=0.02)
        for estimator in (KktConstrained(), Bilevel())
    )
    np.testing.assert_allclose(one.weights, other.weights, atol=1e-4)
    np.testing.assert_allclose(one.parameters, other.parameters, atol=1e-4)
    np.testing.assert_allclose(one.parameter_deviations, other.parameter_deviations, rtol=1e-2)


def test_errors_are_as_large_as_their_deviations_say(states) -> None:
    scaled, squared, bound = [], [], []
    for seed in range(12):
        estimate = estimated(KktConstrained(), states, sigma=0.003, seed=seed)
        assert estimate.covariance is not None
        scaled.append(errors_of(estimate) / estimate.parameter_deviations)
        squared.append(np.sum((estimate.weights - SCENARIO.weights) ** 2))
        bound.append(np.trace(estimate.covariance))
    assert 0.7 < np.sqrt(np.mean(np.square(scaled))) < 1.3
    assert 0.6 < np.sqrt(np.mean(squared) / np.mean(bound)) < 1.4


@pytest.mark.parametrize("estimator", [Ukf(), Particle(count=60, most_draws=4)])
def test_filters_find_goals(estimator, states) -> None:
    estimate = estimated(estimator, states, sigma=0.03)
    assert estimate.converged, estimate.message
    prior = SCENARIO.told.parameters.means - SCENARIO.parameters
    assert np.abs(errors_of(estimate)).mean() < 0.4 * np.abs(prior).mean()
    deviations = estimate.parameter_deviations
    assert (deviations > 0).all()
    assert (deviations < 0.1).all()


def test_the_floor_knows_the_prior_only(states) -> None:
    estimate = estimated(Uniform(), states)
    np.testing.assert_array_equal(estimate.parameters, SCENARIO.told.parameters.means)


def test_ipopt_declines_several_trajectories() -> None:
    reason = "takes one trajectory at a time where a game has unknowns besides weights"
    problem = Problem(SCENARIO.told, VIEWS["full"])
    assert KktConstrained("ipopt").supports_several(problem) == reason
    assert KktConstrained().supports_several(problem) is None


def test_several_trajectories_share_their_unknowns(states) -> None:
    problem, rng = Problem(SCENARIO.told, VIEWS["full"], 0.003), np.random.default_rng(0)
    seen = [Observation(states + 0.003 * rng.standard_normal(states.shape)) for _ in range(4)]
    together = KktConstrained().estimate(problem, seen, rng=rng, budget=30.0)
    alone = [KktConstrained().estimate(problem, one, rng=rng, budget=30.0) for one in seen]
    assert together.converged and together.parameter_deviations is not None
    errors = [np.square(errors_of(one)).sum() for one in alone]
    assert np.square(errors_of(together)).sum() < np.mean(errors)
    shares = together.parameter_deviations / alone[0].parameter_deviations
    np.testing.assert_allclose(shares, 0.5, atol=0.1)


@pytest.mark.parametrize("estimator", [KktResidual(), MaxentResidual()])
def test_residual_methods_decline(estimator) -> None:
    problem = Problem(SCENARIO.told, VIEWS["full"], 0.01)
    reason = "estimates weights only, but player 0 has unknowns: goal x, goal y"
    assert estimator.supports(problem) == reason
    assert estimator.supports(Problem(SCENARIO.game, VIEWS["full"], 0.01)) is None


def test_a_prior_counts_if_asked_and_the_more_the_noise(states) -> None:
    means = SCENARIO.told.parameters.means
    deviations = SCENARIO.told.parameters.deviations
    shares = []
    for sigma in (0.01, 0.3):
        free, pulled = (
            estimated(Bilevel(prior=prior), states, sigma=sigma) for prior in (False, True)
        )
        assert free.converged
        assert pulled.converged
        # In the unit of the prior, the most probable point is never further from the means.
        far, near = (
            np.linalg.norm((one.parameters - means) / deviations) for one in (free, pulled)
        )
        assert near < far
        assert (pulled.parameter_deviations < free.parameter_deviations).all()
        assert (pulled.parameter_deviations < deviations).all()
        assert pulled.extras["objective"] > free.extras["objective"]
        shares.append(near / far)
    assert shares[0] > 0.98
    assert shares[1] < 0.9


def test_gradients_of_a_prior_are_those_of_finite_differences(states) -> None:
    y = states + 0.02 * np.random.default_rng(0).standard_normal(states.shape)
    problem, observation = Problem(SCENARIO.told, VIEWS["full"], 0.02), Observation(y)
    game = first_games(problem, observation)[0]
    chart = RatioChart(game.weights, problem.weight_floor)
    residuals = OuterResiduals(problem, (observation,), (game,), chart, pull=0.5)
    point = residuals.unknowns((game,))
    jacobian = residuals.jacobian(point)
    assert len(jacobian) == y.size + 4  # coordinates of goals
    direction = np.random.default_rng(0).standard_normal(point.size)
    ahead, behind = (residuals.values(point + s * 1e-6 * direction) for s in (1, -1))
    np.testing.assert_allclose(jacobian @ direction, (ahead - behind) / 2e-6, atol=1e-5)
