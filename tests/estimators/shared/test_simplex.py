"""Coordinates of the simplex."""

import numpy as np
import pytest

from olne_bench.estimators.shared.simplex import (
    RatioChart,
    flat_covariance,
    from_log_ratios,
    log_ratios_of,
)

WEIGHTS = np.array([[0.4, 0.2, 0.1, 0.3], [0.1, 0.6, 0.25, 0.05]])


def test_log_ratios_go_there_and_back():
    phi = log_ratios_of(WEIGHTS, 1e-3)
    np.testing.assert_allclose(from_log_ratios(phi, 4, 1e-3), WEIGHTS, atol=1e-14)


def test_any_log_ratios_give_weights_above_the_floor():
    phi = np.random.default_rng(0).uniform(-800, 800, (50, 6))
    weights = from_log_ratios(phi, 4, 1e-3)
    np.testing.assert_allclose(weights.sum(axis=2), 1)
    assert weights.min() >= 1e-3


def test_the_flat_covariance_is_that_of_uniform_samples():
    shares = np.random.default_rng(0).dirichlet(np.ones(4), (200_000, 2))
    phi = np.log(shares[..., :-1] / shares[..., -1:]).reshape(-1, 6)
    np.testing.assert_allclose(flat_covariance(2, 4), np.cov(phi, rowvar=False), atol=0.05)


def test_ratios_go_there_and_back_and_reach_the_floor():
    chart = RatioChart(WEIGHTS, 1e-3)
    ratios = chart.ratios(WEIGHTS)
    np.testing.assert_allclose(chart.weights(ratios), WEIGHTS, atol=1e-14)
    weights = chart.weights(np.zeros(6))
    assert weights.min() == pytest.approx(1e-3)
    np.testing.assert_allclose(weights.sum(axis=1), 1)


def test_a_chart_ends_where_its_reference_does():
    chart = RatioChart(WEIGHTS, 0.0)
    assert chart.holds(WEIGHTS)
    assert not chart.holds(np.array([[0.01, 0.5, 0.29, 0.2], [0.1, 0.6, 0.25, 0.05]]))
