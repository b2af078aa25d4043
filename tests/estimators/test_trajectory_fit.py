"""Trajectories read off observations."""

import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.trajectory_fit import guess_controls, smoothed
from olne_bench.games.dynamics import DOUBLE_INTEGRATOR, UNICYCLE, Dynamics, bicycle, rollout
from olne_bench.games.features import ControlEffort
from olne_bench.games.game import Game, Player


@pytest.mark.parametrize("dynamics", [UNICYCLE, DOUBLE_INTEGRATOR], ids=lambda d: d.name)
def test_controls_of_a_feasible_trajectory_are_found(dynamics: Dynamics) -> None:
    players = (Player((ControlEffort(dynamics.control_names[0]),)),) * 2
    game = Game(players, dynamics, horizon=10, dt=0.25)
    rng = np.random.default_rng(0)
    controls = rng.standard_normal(game.control_shape)
    states = rollout(dynamics, rng.standard_normal(game.state_shape[1:]), controls, game.dt)
    np.testing.assert_allclose(guess_controls(game, states), controls, atol=1e-6)


def test_controls_without_effect_are_zero() -> None:
    """A standing bicycle cannot steer."""
    game = Game((Player((ControlEffort("steering"),)),), bicycle(), horizon=5, dt=0.25)
    states = np.zeros(game.state_shape)
    states[1:, 0, 3] = np.arange(4)  # the first step only accelerates
    controls = guess_controls(game, states)
    assert np.isfinite(controls).all()
    np.testing.assert_allclose(controls[0, 0], [0, 0], atol=1e-9)
    np.testing.assert_allclose(controls[1:, 0, 1], 4.0, atol=1e-6)


def test_smoothing_keeps_straight_lines_and_the_input() -> None:
    game = get_scenario("two_player").game
    line = np.linspace(0, 1, game.horizon)[:, None, None] * np.ones(game.state_shape[1:])
    np.testing.assert_allclose(smoothed(line, 8), line, atol=1e-12)
    noisy = line + np.random.default_rng(0).standard_normal(line.shape)
    before = noisy.copy()
    assert (
        np.abs(np.diff(smoothed(noisy, 8), 2, axis=0)).max()
        < 0.5 * np.abs(np.diff(noisy, 2, axis=0)).max()
    )
    np.testing.assert_array_equal(noisy, before)
    np.testing.assert_array_equal(smoothed(noisy[:2], 8), noisy[:2])
