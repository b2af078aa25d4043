"""Any noise as white noise."""

from dataclasses import replace

import numpy as np

from olne_bench.estimators.protocol import Observation
from olne_bench.estimators.shared.white_noise import white_problem, with_white_noise
from olne_bench.games.model.observation import observe

COVARIANCE = (
    (1.0, 0.6, 0.0, 0.0),
    (0.6, 2.0, 0.0, 0.1),
    (0.0, 0.0, 0.5, 0.0),
    (0.0, 0.1, 0.0, 1.0),
)


def test_independent_noise_stays_as_it_is(seen) -> None:
    problem, (observation,), _ = seen()
    assert white_problem(problem) is problem
    single = Observation(observation.y.astype(np.float32))
    same, (found,) = with_white_noise(problem, single)
    assert same is problem
    assert found.y.dtype == np.float64
    assert found.y.flags.c_contiguous
    np.testing.assert_array_equal(found.y, single.y)
    assert found.extra is None


def test_correlated_noise_becomes_independent_with_unit_scale(seen) -> None:
    problem, (observation,), _ = seen()
    problem = replace(problem, noise_scale=(), noise_covariance=COVARIANCE)
    root, rng = np.linalg.cholesky(COVARIANCE), np.random.default_rng(0)
    errors = []
    for _ in range(200):
        noise = rng.standard_normal(observation.y.shape) @ root.T
        noisy = Observation(observation.y + noise, extra=(observation.y + noise)[0])
        white, (found,) = with_white_noise(problem, noisy)
        expected = observe(white.view, problem.game.dynamics, observation.y)
        errors.append((found.y - expected).reshape(-1, 4))
        np.testing.assert_allclose(found.extra, found.y[0])
    assert white.noise_covariance is None
    assert white.noise_scale == (1.0,) * 4
    np.testing.assert_allclose(np.cov(np.concatenate(errors).T), np.eye(4), atol=0.07)


def test_a_sample_that_is_missing_in_part_is_missing_where_noise_is_correlated(seen) -> None:
    problem, (observation,), _ = seen()
    problem = replace(problem, noise_scale=(), noise_covariance=COVARIANCE)
    y = observation.y.copy()
    y[3, 1, 0] = np.nan
    _, (found,) = with_white_noise(problem, Observation(y))
    assert np.isnan(found.y[3, 1]).all()
    assert np.isfinite(found.y).sum() == y.size - 4
