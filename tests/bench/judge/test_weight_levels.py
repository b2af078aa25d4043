"""Where true weights lie in what estimates say."""

import numpy as np
import pytest
from scipy.stats import kstest, norm

from olne_bench.bench.judge.weight_levels import weight_levels
from olne_bench.estimators.protocol import Estimate

TRUE = np.array([[0.2, 0.3, 0.5], [0.6, 0.3, 0.1]])


def test_ranks_among_samples() -> None:
    samples = np.stack([TRUE + shift for shift in (-0.05, -0.01, 0.0, 0.02)])
    levels = weight_levels(TRUE, Estimate(TRUE, region="samples", samples=samples))
    np.testing.assert_allclose(levels, 2.5 / 4)


def test_samples_from_where_the_truth_comes_from_have_uniform_levels() -> None:
    rng = np.random.default_rng(0)
    levels = []
    for _ in range(300):
        truth, *samples = rng.dirichlet(np.ones(3), size=(101, 2))
        levels.append(
            weight_levels(truth, Estimate(TRUE, region="samples", samples=np.array(samples)))
        )
    for k in np.ndindex(2, 3):
        assert kstest([level[k] for level in levels], "uniform").pvalue > 1e-3


def test_a_covariance_gives_normal_probabilities() -> None:
    deviations = np.array([0.1, 0.2, 0.1, 0.0, 0.1, 0.1])
    weights = TRUE + np.array([[0.1, -0.2, 0.1], [0.0, -0.1, 0.1]])
    given = Estimate(weights, region="covariance", covariance=np.diag(deviations**2))
    levels = weight_levels(TRUE, given)
    assert levels is not None
    low, high = norm.cdf([-1, 1])
    np.testing.assert_allclose(levels, [[low, high, low], [0.5, high, low]])


@pytest.mark.parametrize("weights", [TRUE + 0.01, TRUE - 0.01])
def test_a_wrong_weight_without_variance_is_at_the_end(weights: np.ndarray) -> None:
    given = Estimate(weights, region="covariance", covariance=np.zeros((6, 6)))
    np.testing.assert_allclose(weight_levels(TRUE, given), float(weights[0, 0] < TRUE[0, 0]))


def test_regions_that_say_nothing_about_single_weights() -> None:
    for given in (Estimate(TRUE), Estimate(TRUE, region="likelihood", covariance=np.eye(6))):
        assert weight_levels(TRUE, given) is None
