"""The floor."""

import numpy as np
import pytest

from olne_bench.estimators.protocol import Observation
from olne_bench.estimators.uniform import Uniform


def test_all_weights_are_equal_whatever_is_seen(seen) -> None:
    problem, observations, weights = seen(count=2, sigma=0.1)
    found = Uniform().estimate(problem, observations, rng=np.random.default_rng(0), budget=1.0)
    np.testing.assert_array_equal(found.weights, np.full(weights.shape, 1 / weights.shape[1]))
    assert found.converged


def test_what_is_no_observation_is_refused(seen) -> None:
    problem, (observation,), _ = seen()
    with pytest.raises(ValueError, match="shape"):
        Uniform().estimate(
            problem, Observation(observation.y[1:]), rng=np.random.default_rng(0), budget=1.0
        )
