"""The KKT-residual baseline."""

import casadi as ca
import numpy as np
import pytest

from olne_bench.estimators.kkt_residual import KktResidual, pre_filter, residual_weights
from olne_bench.estimators.protocol import Observation
from olne_bench.games.solve.kkt import kkt_system
from olne_bench.games.solve.olne import solve_olne


def estimate(problem, observations):
    rng = np.random.default_rng(0)
    return KktResidual().estimate(problem, observations, rng=rng, budget=10.0)


@pytest.mark.parametrize("players", [2, 3])
def test_weights_are_found_without_noise(seen, players) -> None:
    problem, observations, weights = seen(players=players)
    found = estimate(problem, observations)
    np.testing.assert_allclose(found.weights, weights / weights.sum(axis=1)[:, None], atol=1e-4)
    assert found.converged
    assert found.extras["objective"] < 1e-8
    np.testing.assert_allclose(found.states, observations[0].y, atol=1e-4)


def test_an_equilibrium_has_its_own_weights(seen) -> None:
    problem, _, weights = seen(seed=2)
    game = problem.game
    truth = solve_olne(game, weights, seen(seed=2)[1][0].y[0])
    found = residual_weights(problem, truth.states, truth.controls)
    np.testing.assert_allclose(found, weights / weights.sum(axis=1)[:, None], atol=1e-6)


def test_costates_that_are_left_out_could_not_do_better(seen) -> None:
    """The reduced residual is the smallest over all costates, by least squares on the system."""
    problem, (observation,), _ = seen(sigma=0.05)
    game = problem.game
    (states, controls, _), _ = pre_filter(problem, observation)
    found = estimate(problem, observation)
    system = kkt_system(game)
    assert found.extras["objective"] > 0
    rows = _rows(game, system, states, controls, found.weights)
    assert found.extras["objective"] == pytest.approx(rows, rel=1e-6)


def _rows(game, system, states, controls, weights) -> float:
    """Smallest squared residual over the costates, controls in units per step."""
    gradient = ca.vertcat(system.stationarity_states, system.stationarity_controls / game.dt)
    jacobian = ca.jacobian(gradient, system.costates)
    function = ca.Function(
        "g",
        [system.states, system.controls, system.costates, system.weights],
        [gradient, jacobian],
    )
    zero = np.zeros(system.costates.numel())
    found = function(states.ravel(), controls.ravel(), zero, weights.ravel())
    constant, slope = (np.array(value) for value in found)
    _, squared, *_ = np.linalg.lstsq(slope, -constant[:, 0], rcond=None)
    return float(squared[0])


def test_the_sample_beyond_the_horizon_is_seen_by_the_pre_filter(seen) -> None:
    problem, (observation,), _ = seen(sigma=0.02)
    longer = Observation(observation.y, extra=observation.y[-1] + 0.3)
    (states, controls, last), fit = pre_filter(problem, longer)
    assert states.shape == problem.game.state_shape
    assert controls.shape == problem.game.control_shape
    assert last.shape == problem.game.control_shape[1:]
    np.testing.assert_array_equal(fit.states[-2], states[-1])
    assert len(fit.states) == len(states) + 1
    (_, _, nothing), _ = pre_filter(problem, observation)
    assert nothing is None
    used, unused = (estimate(problem, one).weights for one in (longer, observation))
    assert np.abs(used - unused).max() > 1e-3


def test_weights_stay_above_their_floor_and_sum_to_one(seen) -> None:
    problem, (observation,), _ = seen(sigma=0.3)
    found = estimate(problem, observation).weights
    np.testing.assert_allclose(found.sum(axis=1), 1)
    assert found.min() >= problem.weight_floor * (1 - 1e-9)


def test_several_trajectories_share_their_weights(seen) -> None:
    problem, observations, weights = seen(count=3, sigma=0.02)
    truth = weights / weights.sum(axis=1)[:, None]
    together = np.abs(estimate(problem, observations).weights - truth).mean()
    alone = [np.abs(estimate(problem, [one]).weights - truth).mean() for one in observations]
    assert together < max(alone)
    assert estimate(problem, observations[:1] * 2).weights == pytest.approx(
        estimate(problem, observations[0]).weights, abs=1e-9
    )
