"""A prior fitted to many drivers."""

import numpy as np
import pytest

from olne_bench.estimators.shared.population import fitted_population
from olne_bench.games.model.weight_prior import FLAT, WeightPrior

TRUE = np.array([8.0, 3.0, 5.0, 2.0])


def test_many_known_drivers_tell_their_distribution() -> None:
    drivers = np.random.default_rng(0).dirichlet(TRUE, 400)
    found = fitted_population([drivers[None, k : k + 2] for k in range(0, 400, 2)], FLAT)
    np.testing.assert_allclose(found.components[0], TRUE, rtol=0.15)


def test_blurred_drivers_tell_it_through_the_prior_of_their_samples() -> None:
    """Samples of a posterior: multinomial counts of the true weights under the prior used."""
    rng, used = np.random.default_rng(1), WeightPrior((2.0,))
    samples = []
    for weights in rng.dirichlet(TRUE, 300):
        counts = rng.multinomial(60, weights)
        samples.append(rng.dirichlet(counts + 2.0, 400)[:, None])
    found = np.array(fitted_population(samples, used).components[0])
    np.testing.assert_allclose(found / found.sum(), TRUE / TRUE.sum(), atol=0.02)
    assert 0.6 < found.sum() / TRUE.sum() < 1.7


def test_drivers_who_are_all_alike_leave_it_finite() -> None:
    same = np.full((50, 4, 3), 1 / 3)
    found = fitted_population([same], FLAT)
    assert np.isfinite(found.components[0]).all()
    assert min(found.components[0]) > 10


def test_too_few_drivers_and_bad_samples_are_refused() -> None:
    with pytest.raises(ValueError, match="at least 3 drivers, got 2"):
        fitted_population([np.full((10, 2, 3), 1 / 3)], FLAT)
    with pytest.raises(ValueError, match="positive and finite"):
        fitted_population([np.zeros((10, 4, 3))], FLAT)
