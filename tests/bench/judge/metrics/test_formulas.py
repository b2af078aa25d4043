"""Formulas of the metrics, including ellipsoids on the simplex."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.linalg import block_diag
from scipy.stats import kstest

from olne_bench.bench.judge.metrics.formulas import (
    cosine_error,
    ellipsoid_level,
    identifiable_cosine_error,
    position_error,
    sample_level,
)

weights = arrays(float, (3, 4), elements=st.floats(0.01, 10))
scales = arrays(float, (3, 1), elements=st.floats(0.01, 100))
deterministic = settings(derandomize=True, deadline=None)


@deterministic
@given(weights, weights, scales)
def test_cosine_error_ignores_each_players_scale(true, estimated, scale):
    expected = cosine_error(true, estimated)
    assert cosine_error(true, scale * estimated) == pytest.approx(expected, abs=1e-12)


@deterministic
@given(weights, weights, st.permutations(range(3)))
def test_cosine_error_ignores_the_order_of_players(true, estimated, order):
    expected = cosine_error(true, estimated)
    assert cosine_error(true[order], estimated[order]) == pytest.approx(expected, abs=1e-12)


@deterministic
@given(weights, weights)
def test_cosine_error_of_non_negative_weights_lies_between_0_and_1(true, estimated):
    assert 0 <= cosine_error(true, estimated) <= 1
    assert cosine_error(true, true) == pytest.approx(0, abs=1e-12)


def test_cosine_error_by_hand():
    assert cosine_error(np.array([[1.0, 0.0]]), np.array([[1.0, 1.0]])) == pytest.approx(
        1 - np.sqrt(0.5)
    )


def test_position_error_looks_at_positions_only():
    states = np.zeros((5, 2, 4))
    other = states.copy()
    other[..., 2:] = 9
    other[..., 0] = 0.5
    assert position_error(states, other) == pytest.approx(0.25)


projections = np.stack([np.eye(4) - 0.25] * 3)


@deterministic
@given(weights, weights, scales)
def test_with_all_identified_the_identifiable_error_is_the_plain_one(true, estimated, scale):
    found = identifiable_cosine_error(true, (scale * estimated)[None], projections)
    assert found == pytest.approx(cosine_error(true, estimated), abs=1e-9)


@deterministic
@given(weights, weights, st.permutations(range(3)))
def test_identifiable_error_ignores_scale_and_order_of_players(true, estimated, order):
    yaw_unseen = np.array([[0.5, -0.5, 0, 0], [1 / 6, 1 / 6, -1 / 3, 0]])
    basis = np.linalg.qr(yaw_unseen.T)[0]
    some = np.stack([basis @ basis.T, projections[0], np.zeros((4, 4))])
    found = identifiable_cosine_error(true, estimated[None], some)
    again = identifiable_cosine_error(true[order], 7 * estimated[order][None], some[order])
    assert again == pytest.approx(found, abs=1e-9)


@deterministic
@given(weights, weights)
def test_where_nothing_is_identified_all_errors_are_forgiven(true, estimated):
    found = identifiable_cosine_error(true, estimated[None], np.zeros((3, 4, 4)))
    assert found == pytest.approx(0, abs=1e-12)


WEIGHTS = np.array([[0.4, 0.2, 0.1, 0.3], [0.25, 0.25, 0.3, 0.2]])
CENTRED = block_diag(*[np.eye(4) - 0.25] * 2)


def covers_truth(weights, estimated, covariance, level=0.95):
    return ellipsoid_level(weights, estimated, covariance) <= level


def test_true_ellipsoids_hold_the_truth_as_often_as_they_say():
    rng = np.random.default_rng(0)
    factor = CENTRED @ rng.standard_normal((8, 8)) * 0.01
    covariance = factor @ factor.T
    draws = (factor @ rng.standard_normal((8, 4000))).T.reshape(-1, 2, 4)
    share = np.mean([covers_truth(WEIGHTS, WEIGHTS + draw, covariance) for draw in draws])
    assert share == pytest.approx(0.95, abs=0.012)
    half = np.mean([covers_truth(WEIGHTS, WEIGHTS + d, covariance, level=0.5) for d in draws])
    assert half == pytest.approx(0.5, abs=0.03)


def test_the_centre_is_inside_and_a_far_point_outside():
    covariance = 1e-4 * CENTRED
    assert covers_truth(WEIGHTS, WEIGHTS, covariance)
    far = WEIGHTS + np.array([[0.1, -0.1, 0, 0], [0, 0, 0, 0]])
    assert not covers_truth(WEIGHTS, far, covariance)


def test_a_covariance_without_extent_holds_what_is_exact_only():
    """It is singular in all directions, or in those of one player's weights."""
    flat = block_diag(1e-4 * CENTRED[:4, :4], np.zeros((4, 4)))
    step = np.array([0.001, -0.001, 0, 0])
    nobody, first, second = 0 * WEIGHTS, np.stack([step, 0 * step]), np.stack([0 * step, step])
    for covariance, inside in (
        (np.zeros((8, 8)), (True, False, False)),
        (flat, (True, True, False)),
    ):
        found = [covers_truth(WEIGHTS, WEIGHTS + e, covariance) for e in (nobody, first, second)]
        assert tuple(found) == inside
    assert not covers_truth(WEIGHTS, WEIGHTS + 100 * first, flat)


def test_what_is_no_covariance_holds_nothing():
    assert not covers_truth(WEIGHTS, WEIGHTS[:, ::-1], -1e-4 * CENTRED)


def test_a_covariance_counts_with_both_its_halves():
    """Entries may differ from their mirror images by rounding; their mean counts."""
    rng = np.random.default_rng(1)
    factor = CENTRED @ rng.standard_normal((8, 8)) * 0.01
    covariance = factor @ factor.T
    skew = np.triu(rng.standard_normal((8, 8)), 1)
    skew = 1e-5 * (skew - skew.T)
    edge = factor @ rng.standard_normal((8, 400))
    inside = [covers_truth(WEIGHTS, WEIGHTS + e.reshape(2, 4), covariance) for e in edge.T]
    again = [covers_truth(WEIGHTS, WEIGHTS + e.reshape(2, 4), covariance + skew) for e in edge.T]
    assert inside == again and 0.9 < np.mean(inside) < 1


def test_levels_of_samples_are_uniform_where_the_truth_is_one_of_them():
    rng = np.random.default_rng(2)
    draws = rng.dirichlet([0.5, 1.0, 3.0, 8.0], size=(300, 81, 2))
    levels = [sample_level(one[0], one[1:]) for one in draws]
    assert kstest(levels, "uniform").pvalue > 0.01
    narrow = [
        sample_level(one[0], one[1:].mean(axis=0) + 0.2 * (one[1:] - one[1:].mean(axis=0)))
        for one in draws
    ]
    assert np.mean(np.array(narrow) <= 0.95) < 0.5
