"""Noise that is not as told."""

from dataclasses import replace

import numpy as np
import pytest

from olne_bench.envs.scenarios.following import CAR, NOISE_SCALE, driver
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.map import Map
from olne_bench.estimators.protocol import COVARIANCE, SAMPLES, Estimate, Observation, Problem
from olne_bench.estimators.robust import Robust
from olne_bench.games.model.game import Game
from olne_bench.games.model.lanes import StraightLane
from olne_bench.games.model.observation import FullView

SIGMA = 0.004


def estimated(estimator, problem, observation) -> Estimate:
    return estimator.estimate(problem, observation, rng=np.random.default_rng(0), budget=60.0)


@pytest.fixture
def errors(seen):
    """A problem, its samples without noise, noise of its level, and the true weights."""
    problem, (clean,), weights = seen(sigma=0.0)
    problem = replace(problem, sigma=SIGMA)
    errors = SIGMA * np.random.default_rng(4).standard_normal(clean.y.shape)
    return problem, clean.y, errors * np.array(problem.noise_scale), weights


def test_without_noise_it_is_the_method_in_use(seen):
    problem, (observation,), weights = seen(view="partial")
    found = estimated(Robust("map"), problem, observation)
    np.testing.assert_allclose(found.weights, weights, atol=1e-6)


def test_it_finds_the_level_whatever_it_is_told(errors):
    problem, clean, noise, _ = errors
    levels = [
        estimated(Robust("map"), replace(problem, sigma=told), Observation(clean + noise)).extras
        for told in (SIGMA / 3, SIGMA, 3 * SIGMA)
    ]
    np.testing.assert_allclose([one["sigma"] for one in levels], levels[1]["sigma"], rtol=0.02)
    # The scale of t noise is below the standard deviation of normal noise that it is fitted to.
    assert 0.7 * SIGMA < levels[1]["sigma"] < 1.05 * SIGMA
    assert [one["lag"] for one in levels] == [0.0] * 3


def test_outliers_hardly_move_it(errors):
    problem, clean, noise, weights = errors
    rng, off = np.random.default_rng(1), {"usual": [], "plain": [], "robust": [], "far": []}
    for _ in range(6):
        usual = noise[rng.permutation(len(noise))]
        far = rng.random(noise.shape[:2]) < 0.05
        shown = Observation(clean + np.where(far[..., None], 12 * usual, usual))
        found = estimated(Robust("map"), problem, shown)
        off["usual"].append(estimated(Map(), problem, Observation(clean + usual)).weights)
        off["plain"].append(estimated(Map(), problem, shown).weights)
        off["robust"].append(found.weights)
        off["far"].append(found.extras["far"])
    assert np.mean(off.pop("far")) > 0.02
    errors = {name: np.abs(np.array(some) - weights).mean() for name, some in off.items()}
    assert errors["robust"] < 1.4 * errors["usual"]
    assert errors["plain"] > 1.5 * errors["robust"]


def test_errors_that_follow_each_other_leave_more_open(errors):
    problem, clean, noise, _ = errors
    lagged = noise.copy()
    for k in range(1, len(noise)):
        lagged[k] = 0.8 * lagged[k - 1] + 0.6 * noise[k]
    plain = estimated(Map(), problem, Observation(clean + lagged))
    found = estimated(Robust("map"), problem, Observation(clean + lagged))
    assert 0.6 < found.extras["lag"] < 0.95
    assert found.region == COVARIANCE
    assert np.trace(found.covariance) > 3 * np.trace(plain.covariance)


def test_samples_are_of_the_method_in_use(errors):
    problem, clean, noise, weights = errors
    found = estimated(Robust(), problem, Observation(clean + noise))
    assert found.region == SAMPLES
    away = np.abs(found.samples - weights)
    assert (away.mean(axis=0) < 0.2).all()


def test_gaps_stay_gaps(errors):
    problem, clean, noise, _ = errors
    shown = clean + noise
    shown[3:6, 0] = np.nan
    found = estimated(Robust("kkt_constrained"), problem, Observation(shown))
    assert found.converged
    assert np.isfinite(found.extras["objective"])


def test_who_stands_leaves_no_noise_to_find():
    """Recorded positions of standing cars are equal to the last digit."""
    lane = (StraightLane((0.0, 0.0), (1.0, 0.0), 100.0),)
    players = tuple(driver(leader=k, target_speed=0.0, route=lane, dt=0.2) for k in (1, -1))
    game = Game(players, CAR, 12, 0.2)
    problem = Problem(game, FullView(), SIGMA, noise_scale=NOISE_SCALE)
    there = np.array([[0.0, 0.0, 0.0, 0.0], [10.0, 0.0, 0.0, 0.0]])
    standing = Observation(np.tile(there, (12, 1, 1)))
    found, plain = (estimated(one, problem, standing) for one in (Robust("map"), Map()))
    np.testing.assert_allclose(found.weights, plain.weights)
    assert "sigma" not in found.extras


def test_few_samples_are_believed_as_told(errors):
    problem, clean, noise, _ = errors
    shown = np.full(clean.shape, np.nan)
    shown[:2] = (clean + noise)[:2]
    found = estimated(Robust("kkt_constrained"), problem, Observation(shown))
    plain = estimated(KktConstrained(), problem, Observation(shown))
    np.testing.assert_array_equal(found.weights, plain.weights)
    assert "sigma" not in found.extras


@pytest.mark.parametrize(
    ("given", "said"),
    [({"of": "ukf"}, "kkt_constrained, map, posterior"), ({"freedom": 0}, "freedom")],
)
def test_bad_parameters_are_refused(given, said):
    with pytest.raises(ValueError, match=said):
        Robust(**given)
