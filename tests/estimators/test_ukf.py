"""The unscented Kalman filter: a linear problem, lost sigma points, small games."""

import time

import numpy as np
import pytest

from olne_bench.estimators.shared.belief import Gaussian, LostError
from olne_bench.estimators.ukf import (
    _MOST_AT_ONCE,
    Ukf,
    _largest_share,
    _regression,
    _sigma_points,
    _updated,
    filter_samples,
)

RNG = np.random.default_rng(0)


def linear_problem(size=5, steps=12, width=3):
    rng = np.random.default_rng(4)
    factor = rng.standard_normal((size, size))
    prior = Gaussian(rng.standard_normal(size), factor @ factor.T + np.eye(size))
    matrices = rng.standard_normal((steps, width, size))
    samples = matrices @ rng.standard_normal(size) + 0.1 * rng.standard_normal((steps, width))
    samples[3, 1], samples[7] = np.nan, np.nan
    return prior, matrices, samples


def through(matrices):
    return lambda points: np.einsum("tdn,bn->btd", matrices, points)


@pytest.mark.parametrize("alpha", [1.0, 0.5, 0.1])
def test_it_equals_a_linear_kalman_filter_on_a_linear_problem(alpha):
    prior, matrices, samples = linear_problem()
    beliefs = filter_samples(prior, through(matrices), samples, 0.1, alpha)
    precision, pull = np.linalg.inv(prior.covariance), np.linalg.solve(prior.covariance, prior.mean)
    for belief, matrix, sample in zip(beliefs, matrices, samples, strict=True):
        known = np.isfinite(sample)
        precision = precision + matrix[known].T @ matrix[known] / 0.01
        pull = pull + matrix[known].T @ sample[known] / 0.01
        np.testing.assert_allclose(belief.mean, np.linalg.solve(precision, pull), atol=1e-8)
        np.testing.assert_allclose(belief.covariance, np.linalg.inv(precision), atol=1e-8)


def sets_of(expected):
    """The expected measurements, and the sets of sigma points that they are asked for."""
    sets = []

    def counted(points):
        if len(points) > 1:
            sets.append(points)
        return expected(points)

    return counted, sets


@pytest.mark.parametrize("sigma", [0.1, 1e-3])
def test_a_linear_problem_needs_one_set_of_sigma_points(sigma):
    prior, matrices, samples = linear_problem()
    counted, sets = sets_of(through(matrices))
    filter_samples(prior, counted, samples, sigma, 0.5)
    assert len(sets) == 1


def bent_problem():
    prior, matrices, samples = linear_problem()

    def expected(points):
        straight = through(matrices)(points)
        return straight + 0.3 * np.sin(straight)

    return prior, expected, expected(prior.mean[None] + 0.3)[0] + 0.02 * samples


def test_sigma_points_are_used_as_long_as_they_serve(monkeypatch):
    """New ones for every share change the belief by far less than its own width."""
    prior, expected, samples = bent_problem()
    counted, sets = sets_of(expected)
    belief = filter_samples(prior, counted, samples, 0.3, 0.5)[-1]
    for name, value in (("_BENT", 1e-9), ("_DRIFT", 0.0)):
        monkeypatch.setattr(f"olne_bench.estimators.ukf.{name}", value)
    every, all_sets = sets_of(expected)
    other = filter_samples(prior, every, samples, 0.3, 0.5)[-1]
    assert 1 < len(sets) < 0.7 * len(all_sets)
    width = np.sqrt(np.diag(other.covariance))
    assert (np.abs(belief.mean - other.mean) < 0.3 * width).all()
    np.testing.assert_allclose(np.sqrt(np.diag(belief.covariance)), width, rtol=0.2)


def shares_of(function, sigma):
    """The share of a measurement of a standard normal state of two components."""
    belief = Gaussian(np.zeros(2), np.eye(2))
    rows = function(_sigma_points(belief, 1.0))
    regression = _regression(belief, 1.0, rows[:, None])
    return _largest_share(regression, belief, 0, np.array([True, True]), sigma)


def test_a_measurement_is_taken_in_by_shares_the_more_precise_it_is():
    """As much at once as keeps its noise in a given ratio to the variance that it removes."""
    scale = np.array([3.0, 1.0])
    assert shares_of(lambda points: scale * points, 0.1) == np.inf
    bent = [lambda points, b=b: scale * points + b * points**2 for b in (0.005, 0.2, 9.0)]
    share, least = shares_of(bent[1], 0.1), _MOST_AT_ONCE * 0.1**2 / 3.0**2
    assert least < share < 1
    np.testing.assert_allclose(shares_of(bent[1], 0.2), 4 * share)
    np.testing.assert_allclose(shares_of(lambda points: bent[1](points) + 5, 0.1), share)
    # What is even in the state is noise to it: all of the measurement, if there is a lot of it, and
    # if it is nothing beside the noise.
    assert shares_of(bent[2], 0.1) == np.inf
    assert shares_of(bent[0], 0.1) > 1


def test_sigma_points_without_a_measurement_draw_the_set_closer():
    prior, matrices, samples = linear_problem()

    def half_defined(points):
        far = np.abs(points - points[0]).max(axis=1) > 0.8
        return np.where(far[:, None, None], np.nan, through(matrices)(points))

    plain = filter_samples(prior, through(matrices), samples, 0.1, 1.0)
    drawn = filter_samples(prior, half_defined, samples, 0.1, 1.0)
    np.testing.assert_allclose(drawn[-1].mean, plain[-1].mean, atol=1e-8)
    np.testing.assert_allclose(drawn[-1].covariance, plain[-1].covariance, atol=1e-8)


def test_a_mean_without_a_measurement_is_the_end():
    prior, _, samples = linear_problem()
    with pytest.raises(LostError, match="no equilibrium at the filter's mean"):
        filter_samples(prior, lambda p: np.full((len(p), 12, 3), np.nan), samples, 0.1, 1.0)


def test_weights_are_at_hand_after_each_measurement(seen):
    problem, (observation,), weights = seen(1, sigma=0.005)
    result = Ukf().estimate(problem, observation, rng=RNG, budget=60)
    online = result.extras["online_weights"]
    assert online.shape == (12, 2, 4)
    np.testing.assert_array_equal(online[-1], result.weights)
    np.testing.assert_allclose(online.sum(axis=2), 1)
    errors = np.linalg.norm(online - weights, axis=(1, 2))
    assert errors[-1] < 0.5 * errors[0]


def test_the_covariance_leaves_the_sums_of_weights_alone(seen):
    problem, (observation,), _ = seen(1, sigma=0.005)
    result = Ukf().estimate(problem, observation, rng=RNG, budget=60)
    assert result.covariance.shape == (8, 8)
    np.testing.assert_allclose(result.covariance @ np.repeat(np.eye(2), 4, axis=1).T, 0, atol=1e-12)


def test_all_of_the_budget_is_for_games(seen, monkeypatch):
    problem, (observation,), _ = seen(1, sigma=0.05)
    left = []

    def stop(_problem, _start, deadline):
        left.append(deadline - time.monotonic())
        raise LostError("enough")

    monkeypatch.setattr("olne_bench.estimators.shared.past_posterior.FollowedGames", stop)
    begin = time.monotonic()
    result = Ukf().estimate(problem, observation, rng=RNG, budget=1000.0)
    assert (result.converged, result.message) == (False, "enough")
    assert 1000 - (time.monotonic() - begin) - 1 <= left[0] <= 1000


def test_time_is_kept(seen):
    problem, (observation,), _ = seen(1, sigma=0.05)
    result = Ukf().estimate(problem, observation, rng=RNG, budget=0.0)
    assert not result.converged
    assert result.message == "time limit reached"


def test_noise_that_rounding_hides_is_said():
    belief, slopes = Gaussian(np.zeros(2), 2.0**100 * np.eye(2)), np.array([[1.0, 0.0], [1.0, 0.0]])
    with pytest.raises(LostError, match="rounding"):
        _updated(belief, np.ones(2), slopes, noise=1e-6 * np.eye(2))
