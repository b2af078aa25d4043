"""The prior of weights: its density, what it excludes, and what estimators need of it."""

import numpy as np
import pytest
from scipy.stats import dirichlet

from olne_bench.games.model.weight_prior import FLAT, WeightPrior

FLOOR = 1e-5
ALPHAS = (0.1, 1.0, 3.0, 30.0, 1e4)
MIXED = WeightPrior(((1.5, 7.0, 1.5, 2.0), (3.0, 3.0, 3.0, 3.0)), (0.3, 0.7))


def test_the_density_is_that_of_dirichlet_distributions_in_log_ratios() -> None:
    shares = np.random.default_rng(0).dirichlet(np.ones(4), 50)
    volume = np.log(shares).sum(axis=1)
    single = dirichlet.logpdf(shares.T, [2.0] * 4)
    np.testing.assert_allclose(WeightPrior((2.0,)).log_density(shares), single + volume)
    parts = [dirichlet.pdf(shares.T, alpha) for alpha in MIXED.components]
    np.testing.assert_allclose(
        MIXED.log_density(shares), np.log(0.3 * parts[0] + 0.7 * parts[1]) + volume
    )


def test_a_touching_distribution_is_below_the_mixture() -> None:
    rng = np.random.default_rng(1)
    here, others = rng.dirichlet(np.ones(4)), rng.dirichlet(np.ones(4), 500)
    alpha = MIXED.effective(here)
    gain = (np.log(others) - np.log(here)) @ alpha
    assert (MIXED.log_density(others) - MIXED.log_density(here) >= gain - 1e-9).all()


def test_the_matched_distribution_has_mean_and_spread_of_samples() -> None:
    rng = np.random.default_rng(2)
    weights = MIXED.sample(rng, 40_000, 4)
    alpha = MIXED.matched(4)
    mean = alpha / alpha.sum()
    np.testing.assert_allclose(mean, weights.mean(axis=0), atol=0.005)
    spread = (mean * (1 - mean)).sum() / (alpha.sum() + 1)
    assert spread == pytest.approx(weights.var(axis=0).sum(), rel=0.03)
    np.testing.assert_array_equal(WeightPrior((6.0,)).matched(3), [6.0] * 3)


@pytest.mark.parametrize("alpha", ALPHAS)
def test_draws_of_the_prior_are_never_excluded(alpha: float) -> None:
    prior = WeightPrior((alpha,))
    for weights in np.random.default_rng(0).dirichlet(np.full(4, alpha), size=(500, 2)):
        assert prior.excluded(weights, FLOOR) is None
    assert prior.excluded(np.full((2, 4), 0.25), FLOOR) is None


def test_a_flat_prior_excludes_nothing_not_even_zero() -> None:
    for corner in (np.eye(4), np.roll(np.eye(4), 1, axis=1)):
        assert FLAT.excluded(corner, FLOOR) is None


def test_a_narrow_prior_excludes_what_is_far_from_equal() -> None:
    weights = np.array([[0.25, 0.25, 0.25, 0.25], [0.3, 0.3, 0.3, 0.1]])
    assert WeightPrior((10.0,)).excluded(weights, FLOOR) is None
    assert WeightPrior((1000.0,)).excluded(weights, FLOOR) == (1, 3)
    assert WeightPrior((1000.0, 10.0)).excluded(weights, FLOOR) is None
    zero = np.array([[0.4, 0.3, 0.3, 0.0]])
    found = [WeightPrior((alpha,)).excluded(zero, FLOOR) for alpha in (0.5, 1, 2, 6, 20)]
    assert found == [None, None, None, (0, 3), (0, 3)]


@pytest.mark.parametrize(
    ("components", "shares", "said"),
    [
        ((), (), "needs a share for each component"),
        ((1.0,), (0.5, 0.5), "1 components and 2 shares"),
        ((1.0, 2.0), (0.5, 0.6), "sum to one"),
        ((1.0, 2.0), (1.0, 0.0), "must be positive"),
        ((0.0,), (), "positive and finite, got 0.0"),
        ((float("nan"),), (), "positive and finite, got nan"),
        (((1.0, -1.0),), (), "positive and finite"),
    ],
)
def test_bad_priors_are_refused(components, shares, said) -> None:
    with pytest.raises(ValueError, match=said):
        WeightPrior(components, shares)


def test_a_prior_knows_how_many_weights_it_is_of() -> None:
    FLAT.check(7)
    with pytest.raises(ValueError, match="of 4 weights per player, the game has 5"):
        MIXED.check(5)


def test_it_says_what_it_is() -> None:
    assert repr(WeightPrior((6.0,))) == "WeightPrior((6.0,))"
    assert eval(repr(MIXED)) == MIXED
