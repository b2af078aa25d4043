"""Trajectories fitted to observations."""

import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.shared import trajectory_fit as module
from olne_bench.estimators.shared.trajectory_fit import (
    fit_trajectory,
    guess_controls,
    guess_states,
    observation_parameters,
    smoothed,
)
from olne_bench.games.model.costs import ControlEffort
from olne_bench.games.model.dynamics import DOUBLE_INTEGRATOR, UNICYCLE, Dynamics, bicycle, rollout
from olne_bench.games.model.game import Game, Player
from olne_bench.games.model.observation import VIEWS, observe


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


def straight(
    speeds: np.ndarray, headings: np.ndarray, horizon: int = 12
) -> tuple[Game, np.ndarray]:
    """A game, and states (T, N, 4) of unicycles that drive straight on."""
    count = len(speeds)
    game = Game((Player((ControlEffort("yaw_rate"),)),) * count, UNICYCLE, horizon, dt=0.5)
    start = np.column_stack([np.arange(count), -np.arange(count), headings, speeds])
    return game, rollout(UNICYCLE, start, np.zeros(game.control_shape), game.dt)


def test_hidden_speeds_are_read_off_the_way_even_in_reverse() -> None:
    game, states = straight(np.array([2.0, -1.0]), np.array([0.5, 2.0]))
    y = observe(VIEWS["partial"], game.dynamics, states)
    np.testing.assert_allclose(guess_states(game, VIEWS["partial"], y), states, atol=1e-9)
    first = guess_states(game, VIEWS["partial"], y[:1])  # nothing tells a speed
    np.testing.assert_array_equal(first[..., :2], states[:1, :, :2])
    np.testing.assert_array_equal(first[..., 3], 0.0)


def test_gaps_are_filled_along_the_line_also_at_the_ends() -> None:
    game, states = straight(np.array([2.0, 1.0, 1.5]), np.array([0.5, -2.0, 0.0]))
    y = states.copy()
    y[[0, 1, 4, 5, 10, 11], 0] = np.nan
    y[:10, 1] = np.nan  # two samples are a line
    np.testing.assert_allclose(guess_states(game, VIEWS["full"], y), states, atol=1e-9)
    y[:11, 1] = np.nan  # and one stays where it is
    y[:, 2] = np.nan
    filled = guess_states(game, VIEWS["full"], y)
    np.testing.assert_allclose(filled[:, 1], np.tile(states[11, 1], (12, 1)))
    assert (filled[:, 2] == 0).all()


@pytest.mark.parametrize("view", ["full", "partial"])
def test_a_feasible_trajectory_explains_itself(view: str) -> None:
    game, states = straight(np.array([2.0, 1.0, 1.5]), np.array([0.5, -2.0, 0.0]))
    rng = np.random.default_rng(0)
    controls = 0.2 * rng.standard_normal(game.control_shape)
    states = rollout(game.dynamics, states[0], controls, game.dt)
    y = observe(VIEWS[view], game.dynamics, states)
    y[3, 1, 2] = np.nan  # the motion tells it
    fit = fit_trajectory(game, VIEWS[view], y)
    assert fit.converged, fit.message
    np.testing.assert_allclose(fit.states[:-1], states[:-1], atol=1e-5)
    np.testing.assert_allclose(fit.controls[:-1], controls[:-1], atol=1e-4)


def test_noise_is_explained_by_motion_at_least_as_well_as_by_the_truth() -> None:
    game, states = straight(np.array([2.0, 1.0]), np.array([0.5, -2.0]))
    scale = (1.0, 0.1, 0.5, 1.0)
    y = states + np.array(scale) * 0.1 * np.random.default_rng(1).standard_normal(states.shape)
    fit = fit_trajectory(game, VIEWS["full"], y, scale)
    played = rollout(game.dynamics, fit.states[0], fit.controls, game.dt)
    np.testing.assert_allclose(fit.states, played, atol=1e-6)
    own, truth = (np.sum(((y - x) / scale) ** 2) for x in (fit.states, states))
    assert own < truth
    rng = np.random.default_rng(2)
    for _ in range(5):  # and no other motion nearby does better
        near = fit.controls + 1e-3 * rng.standard_normal(fit.controls.shape)
        other = rollout(game.dynamics, fit.states[0], near, game.dt)
        assert np.sum(((y - other) / scale) ** 2) > own


def test_a_fit_that_samples_leave_open_is_calm_and_ends_soon() -> None:
    """With gaps there are many best fits of a car; IPOPT wandered among them for 500 iterations."""
    car = bicycle(rear_axle=2.5, sub_steps=6)
    game = Game((Player((ControlEffort("steering"),)),), car, horizon=20, dt=0.4)
    states = rollout(car, np.array([[0.0, 0.0, 0.0, 20.0]]), np.zeros(game.control_shape), game.dt)
    solver = module._fit_solver(module._motion_of(game), VIEWS["partial"], 20)
    rng = np.random.default_rng(0)
    for _ in range(4):
        y = states[..., :3] + (0.2, 0.2, 0.02) * rng.standard_normal(states[..., :3].shape)
        y[rng.random(y.shape[:2]) < 0.3] = np.nan
        fit = fit_trajectory(game, VIEWS["partial"], y, (1.0, 1.0, 0.1))
        assert fit.converged and solver.stats()["iter_count"] < 60
        assert np.abs(fit.controls[..., 1]).max() < 15  # [m/s^2]; 0.2 m of noise are 4 in 0.4 s


def test_what_decides_between_fits_moves_exact_samples_by_millimetres() -> None:
    game, states = straight(np.array([2.0, 1.0]), np.array([0.5, -2.0]))
    rng = np.random.default_rng(3)
    controls = rng.standard_normal(game.control_shape)
    states = rollout(game.dynamics, states[0], controls, game.dt)
    y = states.copy()
    y[4, 1] = np.nan
    fit = fit_trajectory(game, VIEWS["full"], y)
    assert fit.converged
    seen = np.isfinite(y)
    assert np.abs(fit.states - y)[seen].max() < 5e-3


def test_missing_samples_have_no_precision_and_others_one_over_their_scale() -> None:
    y = np.array([[[1.0, np.nan]], [[3.0, 4.0]]])
    samples, precision = np.split(observation_parameters(y, (0.5, 2.0)), 2)
    assert samples.tolist() == [1, 0, 3, 4]
    assert precision.tolist() == [2, 0, 2, 0.5]
    assert observation_parameters(y)[4:].tolist() == [1, 0, 1, 1]
