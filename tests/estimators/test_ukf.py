"""The unscented Kalman filter: a linear problem, lost sigma points, small games."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from olne_bench.estimators.belief import Gaussian, LostError
from olne_bench.estimators.ukf import Ukf, filter_samples

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
    kalman = KalmanFilter(dim_x=5, dim_z=3)
    kalman.x, kalman.P = prior.mean[:, None].copy(), prior.covariance.copy()
    for belief, matrix, sample in zip(beliefs, matrices, samples, strict=True):
        known = np.isfinite(sample)
        if known.any():
            noise = 0.01 * np.eye(known.sum())
            kalman.update(sample[known][:, None], R=noise, H=matrix[known])
        np.testing.assert_allclose(belief.mean, kalman.x[:, 0], atol=1e-8)
        np.testing.assert_allclose(belief.covariance, kalman.P, atol=1e-8)


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


def test_time_is_kept(seen):
    problem, (observation,), _ = seen(1, sigma=0.05)
    result = Ukf().estimate(problem, observation, rng=RNG, budget=0.0)
    assert not result.converged
    assert result.message == "time limit reached"
