"""The weights that filters tell after a sample depend on no later one."""

import numpy as np
import pytest

from olne_bench.estimators.particle import Particle
from olne_bench.estimators.protocol import Observation
from olne_bench.estimators.shared.forward_model import uniform_weights
from olne_bench.estimators.ukf import Ukf

FILTERS = {"ukf": Ukf, "particle": Particle}
SMALL = {"ukf": {}, "particle": {"count": 60, "most_draws": 3}}


def told(name, problem, observations, **parameters):
    estimator = FILTERS[name](**SMALL[name], **parameters)
    found = estimator.estimate(problem, observations, rng=np.random.default_rng(0), budget=60)
    return found.extras["online_weights"]


def altered(observation, count, by):
    y = observation.y.copy()
    y[count:] = by(y[count:])
    return Observation(y)


#: Another motion, noise that nothing explains, and nothing.
CHANGES = {
    "slower": lambda later: 0.98 * later,
    "anything": lambda later: np.random.default_rng(1).standard_normal(later.shape),
    "nothing": lambda later: np.full_like(later, np.nan),
}


@pytest.mark.parametrize("view", ["full", "partial"])
@pytest.mark.parametrize("name", FILTERS)
def test_later_samples_change_nothing_before_them(seen, name, view):
    problem, (observation,), _ = seen(1, sigma=0.02, view=view)
    before = told(name, problem, observation)
    assert before.shape == (12, 2, 4)
    for count, change in ((4, "slower"), (9, "anything"), (7, "nothing")):
        after = told(name, problem, altered(observation, count, CHANGES[change]))
        np.testing.assert_array_equal(after[:count], before[:count])  # to the last bit
        assert len(after) < 12 or not np.array_equal(after[-1], before[-1])


@pytest.mark.parametrize("name", FILTERS)
def test_later_trajectories_change_nothing_either(seen, name):
    problem, observations, _ = seen(1, sigma=0.02, count=2)
    before = told(name, problem, observations)
    assert before.shape == (24, 2, 4)
    after = told(name, problem, [observations[0], altered(observations[1], 5, CHANGES["slower"])])
    np.testing.assert_array_equal(after[:17], before[:17])
    assert not np.array_equal(after[17:], before[17:])
    np.testing.assert_array_equal(told(name, problem, observations[0]), before[:12])


@pytest.mark.parametrize("name", FILTERS)
def test_filters_that_peek_know_the_future(seen, name):
    problem, (observation,), _ = seen(1, sigma=0.02)
    before = told(name, problem, observation, peek=True)
    after = told(name, problem, altered(observation, 8, CHANGES["slower"]), peek=True)
    assert not np.array_equal(after[0], before[0])


@pytest.mark.parametrize("name", FILTERS)
def test_before_players_are_seen_weights_are_those_of_the_prior(seen, name):
    problem, (observation,), _ = seen(1, sigma=0.02)
    online = told(name, problem, observation)
    for early in online[:2]:
        np.testing.assert_allclose(early, uniform_weights(problem), atol=0.005)
    assert np.abs(online[2] - uniform_weights(problem)).max() > 0.01


@pytest.mark.parametrize("sigma", [0.0, 1e-3])
@pytest.mark.parametrize("name", FILTERS)
def test_weights_are_found_where_there_is_little_noise(seen, name, sigma):
    for seed in (1, 2):
        problem, (observation,), weights = seen(seed, sigma=sigma)
        found = FILTERS[name]().estimate(
            problem, observation, rng=np.random.default_rng(0), budget=60
        )
        assert found.converged
        assert np.abs(found.weights - weights).max() < (0.005 if sigma == 0 else 0.03)


@pytest.mark.parametrize("name", FILTERS)
def test_what_no_game_explains_is_said(seen, name):
    problem, (observation,), _ = seen(1, sigma=0.01)
    strange = altered(observation, 9, lambda later: later + 0.5)
    found = FILTERS[name](**SMALL[name]).estimate(
        problem, strange, rng=np.random.default_rng(0), budget=60
    )
    assert not found.converged or "noise does not explain" in found.message
    assert found.message
