"""Coverage of ellipsoids on the simplex."""

import numpy as np
import pytest
from scipy.linalg import block_diag

from olne_bench.bench.judge.metrics import covered

WEIGHTS = np.array([[0.4, 0.2, 0.1, 0.3], [0.25, 0.25, 0.3, 0.2]])
CENTRED = block_diag(*[np.eye(4) - 0.25] * 2)


def test_true_ellipsoids_hold_the_truth_as_often_as_they_say():
    rng = np.random.default_rng(0)
    factor = CENTRED @ rng.standard_normal((8, 8)) * 0.01
    covariance = factor @ factor.T
    draws = (factor @ rng.standard_normal((8, 4000))).T.reshape(-1, 2, 4)
    share = np.mean([covered(WEIGHTS, WEIGHTS + draw, covariance) for draw in draws])
    assert share == pytest.approx(0.95, abs=0.012)
    half = np.mean([covered(WEIGHTS, WEIGHTS + d, covariance, level=0.5) for d in draws])
    assert half == pytest.approx(0.5, abs=0.03)


def test_the_centre_is_inside_and_a_far_point_outside():
    covariance = 1e-4 * CENTRED
    assert covered(WEIGHTS, WEIGHTS, covariance)
    far = WEIGHTS + np.array([[0.1, -0.1, 0, 0], [0, 0, 0, 0]])
    assert not covered(WEIGHTS, far, covariance)


def test_a_covariance_without_extent_holds_what_is_exact_only():
    """It is singular everywhere, or on one player's weights, beyond their sums."""
    flat = block_diag(1e-4 * CENTRED[:4, :4], np.zeros((4, 4)))
    step = np.array([0.001, -0.001, 0, 0])
    nobody, first, second = 0 * WEIGHTS, np.stack([step, 0 * step]), np.stack([0 * step, step])
    for covariance, inside in (
        (np.zeros((8, 8)), (True, False, False)),
        (flat, (True, True, False)),
    ):
        found = [covered(WEIGHTS, WEIGHTS + e, covariance) for e in (nobody, first, second)]
        assert tuple(found) == inside
    assert not covered(WEIGHTS, WEIGHTS + 100 * first, flat)


def test_what_is_no_covariance_holds_nothing():
    assert not covered(WEIGHTS, WEIGHTS[:, ::-1], -1e-4 * CENTRED)
