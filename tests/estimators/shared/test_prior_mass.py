"""What a Dirichlet prior excludes."""

import numpy as np
import pytest

from olne_bench.estimators.shared.prior_mass import excluded_weight

FLOOR = 1e-5
ALPHAS = (0.1, 1.0, 3.0, 30.0, 1e4)


@pytest.mark.parametrize("alpha", ALPHAS)
def test_draws_of_the_prior_are_never_excluded(alpha: float) -> None:
    rng = np.random.default_rng(0)
    for weights in rng.dirichlet(np.full(4, alpha), size=(2000, 2)):
        assert excluded_weight(weights, alpha, FLOOR) is None


@pytest.mark.parametrize("alpha", ALPHAS)
def test_equal_weights_are_never_excluded(alpha: float) -> None:
    assert excluded_weight(np.full((2, 4), 0.25), alpha, FLOOR) is None


def test_a_flat_prior_excludes_nothing_not_even_zero() -> None:
    for corner in (np.eye(4), np.roll(np.eye(4), 1, axis=1)):
        assert excluded_weight(corner, 1.0, FLOOR) is None


def test_a_narrow_prior_excludes_what_is_far_from_equal() -> None:
    weights = np.array([[0.25, 0.25, 0.25, 0.25], [0.3, 0.3, 0.3, 0.1]])
    assert excluded_weight(weights, 10.0, FLOOR) is None
    assert excluded_weight(weights, 1000.0, FLOOR) == (1, 3)
    large = np.array([[0.1, 0.7, 0.1, 0.1], [0.25, 0.25, 0.25, 0.25]])
    assert excluded_weight(large, 1000.0, FLOOR) == (0, 1)


def test_zero_has_mass_near_it_only_while_the_prior_is_wide() -> None:
    weights = np.array([[0.4, 0.3, 0.3, 0.0]])
    excluded = [excluded_weight(weights, alpha, FLOOR) for alpha in (0.5, 1, 2, 6, 20)]
    assert excluded == [None, None, None, (0, 3), (0, 3)]
