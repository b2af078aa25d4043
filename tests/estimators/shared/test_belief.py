"""Beliefs over coordinates of weights and an initial state."""

import time
from dataclasses import replace

import numpy as np
import pytest

from olne_bench.estimators.shared.belief import (
    FollowedGames,
    Gaussian,
    LostError,
    first_game,
    first_weights,
    hidden_positions,
    prior_belief,
)
from olne_bench.estimators.shared.charts import NormalChart
from olne_bench.estimators.shared.forward_model import initial_state_prior, uniform_weights
from olne_bench.games.compiled.complementarity import RELAXATION
from olne_bench.games.compiled.elimination import elimination
from olne_bench.games.model.weight_prior import WeightPrior


@pytest.fixture(scope="module")
def followed(seen):
    problem, (observation,), _ = seen()
    return problem, observation, first_game(problem, observation)


def games(problem, start, seconds=100.0):
    return FollowedGames(problem, start, time.monotonic() + seconds)


def point_of(problem, start):
    place = NormalChart.of(problem).point(start.theta)
    return np.concatenate([place, start.initial_state.ravel()])


def test_the_belief_about_weights_comes_from_the_prior_alone(followed) -> None:
    problem, _, _ = followed
    weights = first_weights(problem, 0.5)
    np.testing.assert_allclose(weights.mean, 0, atol=1e-12)
    np.testing.assert_allclose(weights.covariance, 0.25 * np.eye(6))


def test_a_filter_that_peeks_believes_in_the_first_game(followed) -> None:
    problem, _, start = followed
    weights = first_weights(problem, 0.5, start)
    np.testing.assert_allclose(weights.mean, point_of(problem, start)[:6])
    np.testing.assert_allclose(weights.covariance, 0.25 * np.eye(6))


def test_a_prior_knows_weights_and_where_players_are_first_seen(followed) -> None:
    problem, observation, _ = followed
    known = Gaussian(np.arange(6.0), np.diag(np.arange(1.0, 7.0)))
    prior = prior_belief(problem, observation, known, 0.1)
    mean, deviation = initial_state_prior(problem, observation, 0.1)
    np.testing.assert_array_equal(prior.mean, [*known.mean, *mean.ravel()])
    np.testing.assert_array_equal(prior.covariance[:6, :6], known.covariance)
    np.testing.assert_allclose(np.diag(prior.covariance)[6:], deviation.ravel() ** 2)
    assert not prior.covariance[:6, 6:].any()


@pytest.mark.parametrize("size", [0.01, 0.6])
def test_moments_of_weights_are_those_of_samples(followed, size) -> None:
    problem, _, start = followed
    rng = np.random.default_rng(0)
    factor = size * rng.standard_normal((6, 6))
    mean = point_of(problem, start)[:6]
    samples = mean + rng.standard_normal((200_000, 6)) @ factor.T
    here = games(problem, start)
    weights = here.weights(samples).reshape(-1, 8)
    found = here.weight_belief(Gaussian(mean, factor @ factor.T))
    width = weights.std(axis=0).max()
    np.testing.assert_allclose(found.mean, weights.mean(axis=0), atol=0.1 * width)
    covariance = np.cov(weights, rowvar=False)
    near = 0.02 if size < 0.1 else 0.2
    np.testing.assert_allclose(found.covariance, covariance, atol=near * width**2)
    assert np.linalg.eigvalsh(found.covariance).min() > -1e-12
    np.testing.assert_allclose(found.covariance @ np.repeat(np.eye(2), 4, axis=1).T, 0, atol=1e-12)


def test_a_game_and_its_point_belong_together(followed) -> None:
    problem, _, start = followed
    here = games(problem, start)
    np.testing.assert_allclose(here.point(start), point_of(problem, start))
    corner = np.array([[1.0, 0.0, 0.0, 0.0], [0.25, 0.25, 0.25, 0.25]])
    point = here.point(replace(start, weights=corner))
    assert np.isfinite(point).all()
    np.testing.assert_allclose(here.weights(point[None])[0], corner, atol=1e-4)


def test_the_first_game_is_not_far_from_uniform_weights(followed) -> None:
    problem, observation, start = followed
    assert np.abs(start.root.states - observation.y).max() < 0.2
    assert np.abs(start.weights - uniform_weights(problem)).max() < 0.2


def test_points_are_games(followed) -> None:
    problem, _, start = followed
    point = point_of(problem, start)
    here = games(problem, start)
    assert here.chart.free == 6
    np.testing.assert_allclose(here.weights(point[None])[0], start.weights)
    game = here.play(point)
    np.testing.assert_allclose(game.root.states, start.root.states, atol=1e-6)
    np.testing.assert_allclose(game.weights, start.weights)
    shifted = point.copy()
    shifted[6] += 0.01  # px of the first player
    moved = here.play(shifted)
    np.testing.assert_allclose(moved.initial_state.ravel(), shifted[6:], atol=1e-12)
    samples = here.expected(np.stack([point, shifted]))
    assert samples.shape == (2, problem.game.horizon, 8)
    np.testing.assert_allclose(samples[0].reshape(game.root.states.shape), game.root.states)
    np.testing.assert_allclose(samples[1, 0, 0] - samples[0, 0, 0], 0.01)


def test_what_has_no_equilibrium_is_not_expected_anywhere(followed) -> None:
    problem, _, start = followed
    point = point_of(problem, start)
    far = point.copy()
    far[6:] = 1e4 * np.random.default_rng(0).standard_normal(8)
    samples = games(problem, start).expected(np.stack([point, far]))
    assert np.isfinite(samples[0]).all()
    assert np.isnan(samples[1]).all()
    with pytest.raises(LostError, match="no equilibrium at the filter's last mean"):
        games(problem, start).play(far)


def test_a_point_without_prior_density_has_no_derivative(followed) -> None:
    problem, _, start = followed
    here = games(replace(problem, prior=WeightPrior((6.0,))), start)
    point = here.point(start)
    far = point.copy()
    far[2] = -100.0  # standard deviations: a weight next to nothing
    assert here.tangent(point) is not None
    assert np.isfinite(here.expected(np.stack([point, far]))).all()
    assert here.tangent(far) is None


def test_nothing_is_played_after_the_deadline(followed) -> None:
    problem, _, start = followed
    with pytest.raises(LostError, match="time limit reached"):
        games(problem, start, seconds=-1.0).expected(point_of(problem, start)[None])


def test_positions_have_to_be_told(followed, seen) -> None:
    assert hidden_positions(followed[0]) is None
    assert hidden_positions(seen(view="partial")[0]) is None


def test_tangents_are_those_of_finite_differences(followed) -> None:
    problem, _, start = followed
    forward, point = games(problem, start), point_of(problem, start)
    expected, slopes = forward.tangent(point)
    np.testing.assert_allclose(expected, forward.expected(point[None])[0], atol=1e-6)
    step = 1e-4
    for k in (0, 5, len(point) - 1):
        ahead, behind = (
            forward.expected(np.array([point, point + sign * step * np.eye(len(point))[k]]))[1]
            for sign in (1, -1)
        )
        np.testing.assert_allclose(slopes[..., k], (ahead - behind) / (2 * step), atol=1e-4)


def test_complementarity_is_relaxed_for_filters_only(followed) -> None:
    problem, _, start = followed
    forward, solver = games(problem, start), elimination(problem.game)
    noisy = games(replace(problem, sigma=1.0), start)
    assert noisy._solver.relaxation > forward._solver.relaxation >= RELAXATION
    assert solver.relaxation == RELAXATION
