"""Estimates where most of a motion is still to come."""

from dataclasses import replace

import numpy as np
import pytest

from olne_bench.envs.recordings.recording import Recording
from olne_bench.estimators.bilevel import Bilevel
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.map import Map
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.belief import first_game
from olne_bench.estimators.shared.forward_model import squared_error_of
from olne_bench.estimators.shared.joint_problem import JointPoint
from olne_bench.estimators.shared.joint_starts import Search, largest_explicable, starts
from olne_bench.estimators.shared.trajectory_fit import guess_controls, guess_states, smoothed
from olne_bench.estimators.shared.window_starts import free_drive, is_window, window_points
from olne_bench.games.model.observation import VIEWS
from olne_bench.games.solve.best_response import best_responses
from olne_bench.games.solve.continuation import coupled_features
from olne_bench.games.solve.newton import newton_root

SIGMA, SEEN, AHEAD = 0.1, 8, 8


def a_window(recording: Recording) -> tuple[Problem, np.ndarray]:
    """The first samples of a recording, the others missing, and the problem."""
    scenario = recording.scenario
    noise = np.random.default_rng(30).standard_normal(recording.states.shape)
    y = recording.states + SIGMA * np.array(scenario.noise_scale) * noise
    y[SEEN:] = np.nan
    return Problem(scenario.game, VIEWS["full"], SIGMA, noise_scale=scenario.noise_scale), y


def error_ahead(states: np.ndarray, recording: Recording) -> float:
    """Mean position error some steps after the last sample [m]."""
    away = (states - recording.states)[SEEN - 1 + AHEAD, :, :2]
    return float(np.linalg.norm(away, axis=-1).mean())


@pytest.fixture(scope="module", params=["roundabout", "intersection"])
def bend(request, recorded) -> Recording:
    """A road that bends, and players who begin straight on."""
    return recorded(request.param, 31, num_players=4)


def test_what_is_a_window() -> None:
    y = np.zeros((20, 3, 4))
    assert not is_window(y)
    gone = y.copy()
    gone[8:, 1] = np.nan  # one player leaves the view
    assert is_window(gone)
    gaps = y.copy()
    gaps[[3, 7, 8, 18, 19]] = np.nan
    assert not is_window(gaps)
    assert is_window(np.full_like(y, np.nan))


def test_free_drive_is_everybodys_best_plan_alone(bend) -> None:
    problem, y = a_window(bend)
    game, free = problem.game, free_drive(problem, y)
    alone = np.where(coupled_features(game), 0.0, free.theta)
    for i in range(game.num_players):
        plans = np.stack([free.controls[:, i], 0 * free.controls[:, i]])
        found = best_responses(game, i, plans, free.states, free.controls, alone)
        np.testing.assert_allclose(found.controls[0], free.controls[:, i], atol=1e-4)
        assert found.costs[0] <= found.costs[1] * (
            1 + 1e-9
        )  # coasting leads to none that is better


def test_the_first_point_is_a_game(bend) -> None:
    problem, y = a_window(bend)
    points = window_points(problem, y)
    played, free = points.played, points.free
    assert np.abs(played.states - free.states).max() > 0.1
    np.testing.assert_array_equal(played.states[0], free.states[0])
    root = newton_root(
        problem.game, played.states, played.controls, played.costates, played.weights
    )
    np.testing.assert_allclose(root.states, played.states, atol=1e-6)


def test_samples_and_free_drive_are_joined(bend) -> None:
    problem, y = a_window(bend)
    seen = window_points(problem, y).seen
    assert np.abs(seen.states[:SEEN] - y[:SEEN])[..., :2].max() < 1.5  # smoothing cuts bends
    steps = np.linalg.norm(np.diff(seen.states[..., :2], axis=0), axis=-1)
    assert steps.max() < 2 * 12 * problem.game.dt  # nobody leaps at the joint


def test_the_first_game_of_filters_explains_a_window(bend) -> None:
    problem, y = a_window(bend)
    found = first_game(problem, Observation(y))
    assert squared_error_of(problem, found.root.states, y) <= largest_explicable(problem, [y])
    assert error_ahead(found.root.states, bend) < 2


@pytest.mark.parametrize("estimator", [KktConstrained(), Map(), Bilevel(starts=2)])
def test_estimates_of_windows_predict(bend, estimator) -> None:
    problem, y = a_window(bend)
    rng = np.random.default_rng(0)
    found = estimator.estimate(problem, Observation(y), rng=rng, budget=60)
    assert found.converged
    assert error_ahead(found.states, bend) < 4


def test_one_player_may_leave_the_view(bend) -> None:
    problem, y = a_window(bend)
    noise = SIGMA * np.random.default_rng(1).standard_normal(y.shape)
    y = bend.states + np.array(problem.noise_scale) * noise
    y[5:, 0] = np.nan
    rng = np.random.default_rng(0)
    found = KktConstrained().estimate(problem, Observation(y), rng=rng, budget=60)
    assert found.converged and not found.message
    assert np.linalg.norm((found.states - bend.states)[..., :2], axis=-1).mean() < 1


def test_a_player_who_is_never_seen_is_named(recorded) -> None:
    problem, y = a_window(recorded("two_player"))
    y[:, 1] = np.nan
    rng = np.random.default_rng(0)
    found = KktConstrained().estimate(problem, Observation(y), rng=rng, budget=60)
    assert not found.converged and "player 1" in found.message


def test_starts_of_whole_motions_are_the_observations(bend) -> None:
    problem, y = a_window(bend)
    y = bend.states.copy()
    settings = replace(KktConstrained()._settings(problem), max_iterations=0)
    start, _ = next(starts(problem, y, Search.of(problem, y, settings, np.inf)))
    calm = smoothed(guess_states(problem.game, problem.view, y), 4)
    expected = JointPoint.from_trajectory(problem.game, calm, guess_controls(problem.game, calm))
    np.testing.assert_array_equal(start.states, expected.states)
    np.testing.assert_array_equal(start.controls, expected.controls)
