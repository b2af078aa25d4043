"""The posterior given the samples so far: a linear problem, where filters begin, its best games."""

import time

import numpy as np
import pytest

from olne_bench.estimators.protocol import Observation
from olne_bench.estimators.shared.belief import Gaussian, LateError, LostError
from olne_bench.estimators.shared.forward_model import squared_error_of
from olne_bench.estimators.shared.joint_starts import largest_explicable, unexplained
from olne_bench.estimators.shared.past_posterior import (
    PastGames,
    PastPosterior,
    beginning,
    outset,
)
from olne_bench.estimators.shared.window_starts import first_samples


class Linear:
    """Games whose measurements are linear in points."""

    def __init__(self, matrices):
        self.matrices = matrices

    def expected(self, points):
        return np.einsum("tdn,bn->btd", self.matrices, points)

    def tangent(self, point):
        return self.expected(point[None])[0], self.matrices


def test_the_peak_of_a_linear_problem_is_that_of_a_kalman_filter():
    rng = np.random.default_rng(4)
    factor = rng.standard_normal((5, 5))
    prior = Gaussian(rng.standard_normal(5), factor @ factor.T + np.eye(5))
    matrices, samples = rng.standard_normal((9, 3, 5)), rng.standard_normal((9, 3))
    samples[2, 1] = np.nan
    posterior = PastPosterior(prior, Linear(matrices), samples, 0.1)
    precision, pull = np.linalg.inv(prior.covariance), np.linalg.solve(prior.covariance, prior.mean)
    for t, (matrix, sample) in enumerate(zip(matrices, samples, strict=True)):
        known = np.isfinite(sample)
        precision = precision + 100 * matrix[known].T @ matrix[known]
        pull = pull + 100 * matrix[known].T @ sample[known]
        here = posterior.linearised(posterior.tangent(prior.mean), t)
        peak = posterior.climbed(here, t)
        assert peak.objective < here.objective
        np.testing.assert_allclose(peak.laplace().mean, np.linalg.solve(precision, pull), atol=1e-8)
        np.testing.assert_allclose(peak.laplace().covariance, np.linalg.inv(precision), atol=1e-8)
        moved = posterior.tangent(peak.tangent.point + 0.01)
        there = posterior.objective(moved.point, moved.expected, t)
        rise = 0.01**2 * peak.precision.sum() / 2
        assert there - peak.objective == pytest.approx(rise, rel=1e-3)


def test_a_filter_begins_when_everybody_was_seen_often_enough():
    y = np.zeros((12, 2, 4))
    assert beginning(y) == 2
    y[1:4, 1] = np.nan
    assert beginning(y) == 5
    y[:, 1] = np.nan
    assert beginning(y) == 11
    assert beginning(np.zeros((4, 2, 4))) == 1


@pytest.mark.parametrize("view", ["full", "partial"])
def test_the_most_probable_games_explain_the_samples_so_far(seen, view):
    problem, (observation,), _ = seen(1, sigma=0.01, view=view)
    y = observation.y
    changed = y.copy()
    changed[7:] += 1.0
    here, other = (PastGames(problem, some, time.monotonic() + 60) for some in (y, changed))
    for t in range(2, 7):
        game, same = here.at(t), other.at(t)
        so_far = first_samples(y, t + 1)
        error = squared_error_of(problem, game.root.states, so_far)
        assert error < largest_explicable(problem, [so_far])
        np.testing.assert_array_equal(game.root.states, same.root.states)
        np.testing.assert_array_equal(game.weights, same.weights)


def test_what_noise_does_not_explain_is_named(seen):
    problem, (observation,), _ = seen(1, sigma=0.05)
    most = largest_explicable(problem, [observation.y])
    assert unexplained(problem, 0.9 * most, [observation.y]) == ""
    assert "does not explain the squared error" in unexplained(problem, 1.1 * most, [observation.y])


def test_nothing_begins_after_the_deadline_or_without_a_game(seen):
    problem, (observation,), _ = seen(1, sigma=0.05)
    with pytest.raises(LateError, match="time limit reached"):
        outset(problem, observation, None, 0.5, time.monotonic() - 1, peek=False)
    nowhere = Observation(1e9 * np.random.default_rng(0).standard_normal(observation.y.shape))
    with pytest.raises(LostError, match="no equilibrium found near the samples"):
        outset(problem, nowhere, None, 0.5, time.monotonic() + 60, peek=False)
