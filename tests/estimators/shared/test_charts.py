"""Charts of the simplex: there and back, derivatives, and priors."""

import numpy as np
import pytest
from scipy.stats import beta, kstest, norm

from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.shared.charts import (
    NormalChart,
    RatioChart,
)
from olne_bench.games.model.unknowns import Parameters
from olne_bench.games.model.weight_prior import FLAT, WeightPrior

WEIGHTS = np.array([[0.4, 0.2, 0.1, 0.3], [0.1, 0.6, 0.25, 0.05]])


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


MIXED = WeightPrior(((1.5, 7.0, 1.5, 2.0), (3.0, 3.0, 3.0, 3.0)), (0.3, 0.7))
NO_UNKNOWNS = Parameters(((), ()))


@pytest.mark.parametrize("alpha", [0.5, 1.0, 3.0])
def test_standard_normal_points_are_draws_of_the_dirichlet_distribution(alpha) -> None:
    chart = NormalChart(2, 4, 0.0, WeightPrior((alpha,)), NO_UNKNOWNS)
    weights = chart.weights(np.random.default_rng(0).standard_normal((4000, chart.size)))
    np.testing.assert_allclose(weights.sum(axis=2), 1.0, rtol=1e-12)
    marginal = beta(alpha, 3 * alpha)
    for column in weights.reshape(4000, -1).T:
        assert kstest(column, marginal.cdf).pvalue > 1e-3
    covariance = np.cov(weights[:, 0].T)
    variance = 3 / (16 * (4 * alpha + 1))
    expected = variance * (4 * np.eye(4) - 1) / 3
    np.testing.assert_allclose(covariance, expected, atol=0.08 * variance)


@pytest.mark.parametrize("alpha", [0.2, 1.0, 30.0])
def test_what_is_broken_off_a_stick_is_the_quantile_of_its_distribution(alpha) -> None:
    """Between the knots of the splines, both what is broken off and what is left keep digits."""
    chart = NormalChart(1, 2, 0.0, WeightPrior((alpha,)), Parameters(((),)))
    z = np.linspace(-5.9, 5.9, 977)
    exact = beta(alpha, alpha).ppf(norm.cdf(-np.abs(z)))  # the small part
    weights = chart.weights(z[:, None])[:, 0]
    np.testing.assert_allclose(weights.min(axis=1), exact, rtol=1e-8)


def test_points_and_weights_belong_to_each_other() -> None:
    chart = NormalChart(2, 3, 1e-5, FLAT, NO_UNKNOWNS)
    points = np.random.default_rng(0).uniform(-6, 6, (200, chart.size))
    for point in points:
        theta = chart.theta(point)
        assert (theta >= 1e-5).all()
        again = chart.theta(chart.point(theta))
        np.testing.assert_allclose(again, theta, rtol=1e-8)


def test_weights_at_their_floor_have_coordinates() -> None:
    chart = NormalChart(1, 3, 1e-5, FLAT, Parameters(((),)))
    for weights in ([[1 - 2e-5, 1e-5, 1e-5]], [[1e-5, 1e-5, 1 - 2e-5]], [[1e-5, 0.5, 0.49999]]):
        point = chart.point(np.array(weights))
        assert np.isfinite(point).all()
        np.testing.assert_allclose(chart.weights(point), weights, atol=1e-7)


def test_unknowns_have_a_normal_prior_within_their_range() -> None:
    parameters = get_scenario("unknown_goals", 0).told.parameters
    chart = NormalChart(2, 4, 1e-5, FLAT, parameters)
    assert chart.size == 6 + 4
    points = np.random.default_rng(0).standard_normal((500, chart.size))
    theta = chart.theta(points)
    low, high = parameters.bounds()
    assert ((theta[..., 4:] > low) & (theta[..., 4:] < high)).all()
    for point, one in zip(points[:20], theta[:20], strict=True):
        np.testing.assert_allclose(chart.point(one), point, atol=1e-7)


@pytest.mark.parametrize("prior", [FLAT, WeightPrior((0.4,)), MIXED])
def test_the_jacobian_is_that_of_theta(prior) -> None:
    chart = NormalChart(2, 4, 1e-5, prior, get_scenario("unknown_goals", 0).told.parameters)
    point = np.random.default_rng(1).standard_normal(chart.size)
    change = 1e-3 * np.random.default_rng(2).standard_normal(chart.size)
    actual = chart.theta(point + change) - chart.theta(point - change)
    np.testing.assert_allclose(2 * chart.jacobian(point) @ change, actual.ravel(), atol=1e-8)


def test_a_tilt_makes_a_mixture_of_a_chart() -> None:
    chart = NormalChart(1, 4, 0.0, MIXED, Parameters(((),)))
    points = np.random.default_rng(3).standard_normal((40_000, chart.size))
    shares = np.exp(chart.tilt(points))
    assert shares.mean() == pytest.approx(1, abs=0.05)
    mean = shares @ chart.weights(points)[:, 0] / shares.sum()
    drawn = MIXED.sample(np.random.default_rng(4), 40_000, 4)
    np.testing.assert_allclose(mean, drawn.mean(axis=0), atol=0.01)
    assert not NormalChart(1, 4, 0.0, FLAT, Parameters(((),))).tilt(points).any()
