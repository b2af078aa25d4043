"""Mixtures, and the networks that tell them."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from olne_bench.estimators.shared.mixture_network import Mixture, encoded

RNG = np.random.default_rng(0)


@pytest.fixture(scope="module")
def mixture() -> Mixture:
    triangles = np.array([[[2.0, 0.0], [1.0, 0.5]], [[1.0, 0.0], [0.0, 3.0]]])
    return Mixture(np.log([3.0, 1.0]), np.array([[0.0, 1.0], [4.0, -2.0]]), triangles)


def test_the_density_is_that_of_the_gaussians(mixture) -> None:
    points = RNG.standard_normal((5, 2)) * 3
    parts = [
        multivariate_normal(mean, np.linalg.inv(triangle.T @ triangle)).pdf(points)
        for mean, triangle in zip(mixture.means, mixture.triangles, strict=True)
    ]
    expected = np.log(0.75 * parts[0] + 0.25 * parts[1])
    np.testing.assert_allclose(mixture.log_density(points), expected)


def test_samples_have_the_moments_of_the_gaussians(mixture) -> None:
    points = mixture.samples(100_000, np.random.default_rng(1))
    np.testing.assert_allclose(points.mean(axis=0), [1.0, 0.25], atol=0.03)
    covariances = np.linalg.inv(np.swapaxes(mixture.triangles, 1, 2) @ mixture.triangles)
    away = mixture.means - [1.0, 0.25]
    each = covariances + away[:, :, None] * away[:, None, :]
    expected = 0.75 * each[0] + 0.25 * each[1]
    np.testing.assert_allclose(np.cov(points, rowvar=False), expected, rtol=0.03)


def test_what_is_missing_says_nothing() -> None:
    centre, spread = RNG.standard_normal((3, 2, 4)), np.full((3, 2, 4), 0.5)
    states = RNG.standard_normal((2, 3, 2, 4))
    states[1, 2, 0] = np.nan
    states[1, :, :, 3] = np.nan
    inputs = encoded(states, np.array([0.1, 0.2]), centre, spread, np.zeros(2, dtype=int), 1)
    assert inputs.shape == (2, 24 + 6 + 4 + 1)
    np.testing.assert_allclose(inputs[0, :24], ((states[0] - centre) / 0.5).ravel(), rtol=1e-5)
    assert inputs[0, 24:34].all()
    assert not inputs[1, :24].reshape(3, 2, 4)[2, 0].any()
    np.testing.assert_array_equal(inputs[1, 24:34], [1, 1, 1, 1, 0, 1, 1, 1, 1, 0])
    np.testing.assert_allclose(inputs[:, 34], np.log([0.1, 0.2]), rtol=1e-6)
