from collections.abc import Callable

import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.games.model.costs import ControlEffort, Proximity, StateDeviation
from olne_bench.games.model.dynamics import UNICYCLE
from olne_bench.games.model.game import Game, Player
from olne_bench.games.model.observation import VIEWS, FullView
from olne_bench.games.solve.information import (
    cosine_error_limit,
    identifiability,
    joint_weight_covariance,
    observation_sensitivity,
    trajectory_sensitivity,
    weight_covariance,
)
from olne_bench.games.solve.olne import Equilibrium, solve_olne

Crossing = tuple[Game, np.ndarray, np.ndarray]


def test_sensitivity_against_finite_differences(crossing: Crossing, olne: Equilibrium) -> None:
    game, weights, initial_state = crossing
    sensitivity = trajectory_sensitivity(game, olne.states, olne.controls, olne.costates, weights)
    assert sensitivity.shape == (olne.states.size, weights.size + initial_state.size)
    rng, h = np.random.default_rng(0), 1e-4
    for _ in range(4):
        # solve_olne scales rows to sum one, so weights move within the simplex.
        in_weights = rng.standard_normal(weights.shape)
        in_weights -= in_weights.mean(axis=1, keepdims=True)
        in_state = rng.standard_normal(initial_state.shape)
        up, down = (
            solve_olne(game, weights + s * in_weights, initial_state + s * in_state).states
            for s in (h, -h)
        )
        slope = ((up - down) / (2 * h)).ravel()
        predicted = sensitivity @ np.concatenate([in_weights.ravel(), in_state.ravel()])
        np.testing.assert_allclose(predicted, slope, atol=1e-5 * np.abs(slope).max())


@pytest.mark.parametrize(
    ("name", "view", "limit", "tolerance"),
    [
        ("two_player", "full", 21.9, 0.05),
        ("two_player", "partial", 62.7, 0.05),
        ("highway_overtaking", "full", 16_700, 100),
        ("highway_overtaking", "partial", 16_700, 100),
    ],
)
def test_published_limits(
    name: str,
    view: str,
    limit: float,
    tolerance: float,
    scenario_equilibrium: Callable[[str], Equilibrium],
) -> None:
    scenario, found = get_scenario(name), scenario_equilibrium(name)
    covariance = weight_covariance(
        scenario.game, VIEWS[view], found.states, found.controls, found.costates, scenario.weights
    )
    assert covariance is not None
    assert cosine_error_limit(covariance, scenario.weights) == pytest.approx(limit, abs=tolerance)


def test_covariance_is_one_and_lives_on_the_simplex(crossing: Crossing, olne: Equilibrium) -> None:
    game, weights, _ = crossing
    arguments = (olne.states, olne.controls, olne.costates, weights)
    full, partial = (weight_covariance(game, VIEWS[v], *arguments) for v in ("full", "partial"))
    assert full is not None and partial is not None
    np.testing.assert_allclose(full, full.T, rtol=1e-6, atol=1e-9 * np.abs(full).max())
    assert np.linalg.eigvalsh(full).min() > -1e-9 * np.abs(full).max()
    ones = np.kron(np.eye(3), np.ones((4, 1)))
    assert np.abs(full @ ones).max() < 1e-9 * np.abs(full).max()
    # Seeing less cannot make the weights better known.
    assert np.linalg.eigvalsh(partial - full).min() > -1e-9 * np.abs(partial).max()


def test_noise_scales_count(crossing: Crossing, olne: Equilibrium) -> None:
    game, weights, _ = crossing

    def covariance(view: str, scale: np.ndarray | None = None) -> np.ndarray:
        arguments = (olne.states, olne.controls, olne.costates, weights)
        result = weight_covariance(game, VIEWS[view], *arguments, noise_scale=scale)
        assert result is not None
        return result

    np.testing.assert_allclose(covariance("full", np.full(4, 3.0)), 9 * covariance("full"))
    # Speeds of enormous noise say as much as none.
    unseen = covariance("full", np.array([1.0, 1.0, 1.0, 1e6]))
    np.testing.assert_allclose(unseen, covariance("partial"), rtol=1e-4)


@pytest.fixture(scope="module")
def alone() -> tuple:
    """A single player, whose weight on proximity has no visible effect: game, view and point."""
    preferences = (Proximity(), StateDeviation("speed"), ControlEffort("acceleration"))
    game = Game((Player((*preferences, ControlEffort("yaw_rate"))),), UNICYCLE, 8, 0.25)
    weights = np.full((1, 4), 0.25)
    found = solve_olne(game, weights, np.array([[0.0, 0.0, 0.3, 1.0]]))
    return game, FullView(), found.states, found.controls, found.costates, weights


def test_what_cannot_be_known_is_said_so(alone: tuple) -> None:
    assert weight_covariance(*alone) is None


def test_cosine_limit_is_the_mean_error_of_a_gaussian_estimate() -> None:
    """The second-order formula against a Monte Carlo of eqn. cosine_metric."""
    rng = np.random.default_rng(0)
    weights = np.array([[0.4, 0.3, 0.2, 0.1], [0.25, 0.25, 0.25, 0.25]])
    root = 1e-3 * rng.standard_normal((8, 8))
    covariance = root @ root.T
    samples = weights + (rng.standard_normal((200_000, 8)) @ root.T).reshape(-1, 2, 4)
    norms = np.linalg.norm(samples, axis=2) * np.linalg.norm(weights, axis=1)
    errors = 1 - (np.einsum("sik,ik->si", samples, weights) / norms).mean(axis=1)
    assert cosine_error_limit(covariance, weights) == pytest.approx(errors.mean(), rel=0.02)


def test_identifiability_agrees_with_the_bound(crossing: Crossing, olne: Equilibrium) -> None:
    game, weights, _ = crossing
    arguments = (game, FullView(), olne.states, olne.controls, olne.costates, weights)
    covariance = weight_covariance(*arguments)
    assert covariance is not None
    deviations = np.sqrt(np.diag(covariance)).reshape(weights.shape)
    seen = [observation_sensitivity(*arguments)]
    fine, coarse = (identifiability(game, seen, sigma=sigma) for sigma in (1e-6, 1e6))
    np.testing.assert_allclose(fine.bound, 1e-6 * deviations, rtol=1e-6)
    assert fine.identified.all() and fine.left.max() < 1e-3
    assert not coarse.identified.any() and coarse.left.min() > 0.99
    simplex = np.eye(4) - 0.25
    np.testing.assert_allclose(fine.projections, [simplex] * 3, atol=1e-9)
    np.testing.assert_allclose(coarse.projections, 0, atol=1e-12)


def test_the_rest_is_identified_where_one_weight_is_not(alone: tuple) -> None:
    known = identifiability(alone[0], [observation_sensitivity(*alone)], sigma=1e-6)
    assert np.isinf(known.bound[0, 0])
    assert not known.identified[0, 0]
    projection = known.projections[0]
    np.testing.assert_allclose(projection @ projection, projection, atol=1e-9)
    np.testing.assert_allclose(projection @ np.ones(4), 0, atol=1e-9)
    assert np.trace(projection) == pytest.approx(1)  # speed against acceleration


@pytest.mark.parametrize("sigma", [0.01, 0.1, 1.0])
def test_what_is_left_is_the_posterior_of_a_gaussian_prior(
    sigma: float, crossing: Crossing, olne: Equilibrium
) -> None:
    """The prior has the covariance of weights that are uniform on the simplex."""
    game, weights, _ = crossing
    arguments = (game, FullView(), olne.states, olne.controls, olne.costates, weights)
    covariance = weight_covariance(*arguments)
    assert covariance is not None
    prior = (np.diag(np.full(4, 0.25)) - 1 / 16) / 5  # Dirichlet(1, 1, 1, 1)
    tangent = np.kron(np.eye(3), np.linalg.svd(np.ones((1, 4)))[2][1:].T)
    before = tangent.T @ np.kron(np.eye(3), prior) @ tangent
    data = np.linalg.inv(tangent.T @ covariance @ tangent) / sigma**2
    after = tangent @ np.linalg.inv(np.linalg.inv(before) + data) @ tangent.T
    known = identifiability(game, [observation_sensitivity(*arguments)], sigma=sigma)
    expected = np.diag(after).reshape(3, 4) / np.diag(prior)
    np.testing.assert_allclose(known.left, expected, rtol=1e-5)
    np.testing.assert_array_equal(known.identified, known.bound**2 < np.diag(prior))
    for i, projection in enumerate(known.projections):
        own = tangent[4 * i : 4 * i + 4, 3 * i : 3 * i + 3]
        block = own.T @ after[4 * i : 4 * i + 4, 4 * i : 4 * i + 4] @ own
        assert np.trace(projection) == pytest.approx(
            (np.linalg.eigvalsh(block) * 20 < 0.5).sum(), abs=1e-9
        )


def test_unknowns_have_bounds_and_widen_those_of_weights() -> None:
    """Against the Cramer-Rao bound, and against the same game whose goals are known."""
    scenario = get_scenario("unknown_goals", 0)
    found = solve_olne(scenario.game, scenario.weights, scenario.initial_state)
    point = FullView(), found.states, found.controls, found.costates
    told = scenario.told
    seen = observation_sensitivity(told, *point, scenario.theta)
    known = identifiability(told, [seen], sigma=1e-6)
    covariance = joint_weight_covariance(told, [seen])
    deviations = 1e-6 * np.sqrt(np.diag(covariance)).reshape(2, 6)
    np.testing.assert_allclose(known.bound, deviations[:, :4], rtol=1e-6)
    np.testing.assert_allclose(known.parameter_bound, deviations[:, 4:], rtol=1e-6)
    assert known.parameters_identified.all()
    assert known.parameter_left.max() < 1e-3
    alone = observation_sensitivity(scenario.game, *point, scenario.weights)
    without = identifiability(scenario.game, [alone], sigma=1e-6)
    assert (known.bound > without.bound).all()
    assert without.parameter_bound.shape == (2, 0)
    blurred = identifiability(told, [seen], sigma=1e6)
    assert not blurred.parameters_identified.any()
    assert blurred.parameter_left.min() > 0.99
