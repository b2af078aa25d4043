"""Several motions through the public interface."""

import numpy as np
import pytest

import olne_bench as ob


@pytest.fixture(scope="module")
def seen():
    pairs = [ob.observe(ob.scenario("two_player"), sigma=0.01, seed=seed) for seed in range(3)]
    return [list(some) for some in zip(*pairs, strict=True)]


def test_weights_are_estimated_together(seen) -> None:
    problems, observations = seen
    truth = ob.scenario("two_player").weights
    together = ob.estimate_together(problems, observations)
    alone = ob.estimate(problems[0], observations[0], "map")
    assert together.converged
    assert np.abs(together.weights - truth).max() < np.abs(alone.weights - truth).max() + 0.02
    strangers = ob.estimate_together(problems, observations, drivers=[(0, 1), (2, 3), (4, 5)])
    np.testing.assert_allclose(strangers.weights[:2], alone.weights, atol=1e-5)


def test_a_population_is_fitted(seen) -> None:
    problems, observations = (some[:2] for some in seen)
    prior = ob.population(problems, observations)
    assert len(prior.parameters(4)[0]) == 4
    told = ob.estimate_together(problems, observations, "posterior")
    assert told.samples is not None


def test_bad_requests_are_told(seen) -> None:
    problems, observations = seen
    with pytest.raises(ValueError, match="got 3, 2 and 3"):
        ob.estimate_together(problems, observations[:2])
    with pytest.raises(ValueError, match="'uniform' takes motions of unlike cars one by one"):
        ob.estimate_together(problems, observations, "uniform")
    with pytest.raises(ValueError, match="'imperfect' takes motions of unlike cars one by one"):
        ob.estimate_together(problems, observations, "imperfect")
