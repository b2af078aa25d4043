"""Residuals, standard errors and unexplained players."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import beta

from olne_bench.bench.judge.fit import Fit
from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.protocol import Estimate, Problem
from olne_bench.games.model.observation import FullView

GAME = get_scenario("two_player").game


def fit(sigma: float, error: float, *, covariance: bool = True, states: bool = True) -> Fit:
    """A fit in which player 1 is observed ``error`` units of noise away from its estimate."""
    expected = np.random.default_rng(0).normal(size=GAME.state_shape)
    scale = np.array([1.0, 1.0, 0.1, 2.0])
    y = expected.copy()
    y[:, 1] += error * scale
    y[3, 0] = np.nan
    result = Estimate(
        weights=np.full((2, 4), 0.25),
        states=expected if states else None,
        covariance=4e-4 * np.eye(8) if covariance else None,
    )
    return Fit(Problem(GAME, FullView(), sigma=sigma, noise_scale=tuple(scale)), y, result)


def test_residuals_count_in_units_of_the_noise() -> None:
    found = fit(0.1, 0.3)
    assert found.residuals is not None
    np.testing.assert_allclose(found.residuals, [0.0, 0.3], atol=1e-12)
    steps = GAME.horizon
    assert found.residual == pytest.approx(0.3 * np.sqrt(steps / (2 * steps - 1)))


def test_only_residuals_far_above_the_noise_are_unexplained() -> None:
    assert fit(0.1, 0.3).unexplained == [1]
    assert fit(0.2, 0.3).unexplained == []
    assert fit(1e-6, 0.009).unexplained == []  # positions are rounded


def test_standard_errors_grow_with_a_residual_above_the_noise() -> None:
    small = fit(0.5, 0.3)
    np.testing.assert_allclose(small.standard_errors, np.full((2, 4), 0.02))
    large = fit(0.01, 0.3)
    assert large.residual is not None
    np.testing.assert_allclose(large.standard_errors, np.full((2, 4), 2 * large.residual))


def test_estimators_may_give_neither() -> None:
    assert fit(0.1, 0.3, covariance=False).standard_errors is None
    without = fit(0.1, 0.3, states=False)
    assert without.residual is None and without.unexplained == []
    np.testing.assert_allclose(without.standard_errors, 0.02)


def test_intervals_follow_what_is_claimed() -> None:
    silent = fit(0.5, 0.3)
    assert silent.intervals() is None
    normal = replace(silent, result=replace(silent.result, region="covariance"))
    assert normal.intervals() is not None
    np.testing.assert_allclose(
        normal.intervals(), [0.25 - 0.0392, 0.25 + 0.0392] * np.ones((2, 4, 2)), atol=1e-4
    )
    samples = np.random.default_rng(0).dirichlet(np.ones(4), size=(2000, 2))
    claim = replace(silent.result, region="samples", samples=samples)
    sampled = replace(silent, result=claim)
    assert sampled.intervals() is not None
    tails = beta(1, 3).ppf([0.025, 0.975])
    np.testing.assert_allclose(sampled.intervals(), tails * np.ones((2, 4, 2)), atol=0.03)


def test_states_that_are_no_motion_of_the_game_give_no_profile() -> None:
    found = fit(0.5, 0.3)
    claimed = replace(found, result=replace(found.result, region="likelihood"))
    assert claimed.intervals() is None or np.isnan(claimed.intervals()).any()
