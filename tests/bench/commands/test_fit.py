"""Residuals, standard errors and unexplained players."""

import numpy as np
import pytest

from olne_bench.bench.commands.fit import Fit
from olne_bench.bench.judge.estimate_check import CheckedEstimate
from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.protocol import Problem
from olne_bench.games.observation import FullView

GAME = get_scenario("two_player").game


def fit(sigma: float, error: float, *, covariance: bool = True, states: bool = True) -> Fit:
    """A fit in which player 1 is observed ``error`` units of noise away from its estimate."""
    expected = np.random.default_rng(0).normal(size=GAME.state_shape)
    scale = np.array([1.0, 1.0, 0.1, 2.0])
    y = expected.copy()
    y[:, 1] += error * scale
    y[3, 0] = np.nan
    result = CheckedEstimate(
        weights=np.full((2, 4), 0.25),
        states=expected if states else None,
        covariance=4e-4 * np.eye(8) if covariance else None,
        converged=True,
        message="",
        objective=None,
        extras=None,
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
