"""The forward game as estimators use it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from olne_bench.estimators.protocol import Observation
from olne_bench.estimators.shared import certainty, forward_model
from olne_bench.estimators.shared.certainty import likelihood_certainty
from olne_bench.estimators.shared.forward_model import (
    expected_samples,
    first_games,
    fitted_game,
    initial_state_prior,
    play_batch,
    scaled_samples,
    squared_error_of,
    uniform_weights,
)
from olne_bench.games.model.observation import ComponentView, RangeBearingView
from olne_bench.games.solve.olne import RESIDUAL_TOLERANCE


def test_the_first_games_are_roots_near_the_observation_the_best_first(seen) -> None:
    problem, (observation,), weights = seen()
    games = first_games(problem, observation)
    errors = [squared_error_of(problem, one.root.states, observation.y) for one in games]
    assert errors == sorted(errors)
    assert all(one.root.residual < RESIDUAL_TOLERANCE for one in games)
    # The residual method knows the weights without noise, and halfway is halfway to uniform.
    truth, uniform = weights / weights.sum(axis=1)[:, None], uniform_weights(problem)
    np.testing.assert_allclose(games[0].weights, truth, atol=1e-3)
    assert errors[0] < 1e-6
    used = [one.weights for one in games]
    assert any(np.allclose(found, (uniform + truth) / 2, atol=1e-3) for found in used)
    for i, one in enumerate(games):
        assert all(np.abs(one.root.states - other.root.states).max() > 1e-6 for other in games[:i])


def test_a_fitted_game_fits_better_the_looser_its_weights_are_tied(seen) -> None:
    problem, (observation,), _ = seen(sigma=0.05)
    tight, loose = (fitted_game(problem, observation, tie) for tie in (10.0, 0.1))
    errors = [squared_error_of(problem, one.root.states, observation.y) for one in (tight, loose)]
    assert errors[1] < errors[0]
    away = [np.abs(one.weights - uniform_weights(problem)).max() for one in (tight, loose)]
    assert away[0] < away[1]


def test_samples_are_in_units_of_their_noise(seen) -> None:
    problem, (observation,), _ = seen()
    scaled = replace(problem, noise_scale=(0.5, 2.0, 1.0, 4.0))
    y = observation.y + 0.5
    y[2, 1] = np.nan
    expected = np.nansum(((y - observation.y) / [0.5, 2, 1, 4]) ** 2)
    assert squared_error_of(scaled, observation.y, y) == pytest.approx(expected)
    assert scaled_samples(scaled, y).shape == (len(y), y[0].size)
    np.testing.assert_allclose(
        expected_samples(scaled, observation.y)[:, 4:], observation.y[:, 1] / [0.5, 2, 1, 4]
    )


def test_x_1_is_known_about_as_well_as_a_measurement_knows_it(seen) -> None:
    problem, (observation,), _ = seen()
    scaled = replace(problem, noise_scale=(0.5, 2.0, 1.0, 4.0))
    mean, deviation = initial_state_prior(scaled, observation, 0.1)
    np.testing.assert_allclose(mean, observation.y[0])
    np.testing.assert_allclose(deviation, np.tile([0.1, 0.4, 0.2, 0.8], (2, 1)), rtol=1e-6)


def test_x_1_is_known_less_where_the_first_measurements_are_missing(seen) -> None:
    problem, (observation,), _ = seen()
    y = observation.y.copy()
    y[:2, 1] = np.nan
    _, deviation = initial_state_prior(problem, Observation(y), 0.1)
    np.testing.assert_allclose(deviation[0], 0.2, rtol=1e-6)
    np.testing.assert_allclose(deviation[1, 2:], 3 * 0.2, rtol=1e-6)
    assert (deviation[1, :2] >= 3 * 0.2 * (1 - 1e-6)).all()


def test_speeds_that_are_not_seen_come_from_a_quarter_of_the_way(seen) -> None:
    problem, (observation,), _ = seen(view="partial")
    truth = seen()[1][0].y
    mean, deviation = initial_state_prior(problem, observation, 0.0)
    np.testing.assert_allclose(mean[:, 3], truth[:3, :, 3].mean(axis=0), rtol=0.2)
    np.testing.assert_allclose(deviation[:, 3], np.abs(mean[:, 3]) / 2)
    _, noisy = initial_state_prior(problem, observation, 0.1)
    one_step = np.sqrt(2) * 0.1 / problem.game.dt / np.sqrt(3)
    np.testing.assert_allclose(noisy[:, 3], deviation[:, 3] + one_step, rtol=1e-6)


def test_headings_that_are_not_seen_are_known_by_the_way_and_never_worse_than_sideways(
    seen,
) -> None:
    problem, (observation,), _ = seen()
    view = ComponentView("positions", ("px", "py"))
    hidden, positions = (
        replace(problem, view=view, noise_scale=()),
        Observation(observation.y[..., :2]),
    )
    exact, noisy, lost = (
        initial_state_prior(hidden, positions, sigma)[1][:, 2] for sigma in (0.0, 0.001, 100.0)
    )
    assert (exact > 0).all()
    assert (exact < noisy).all()
    assert (noisy < 1).all()
    np.testing.assert_allclose(lost, np.pi / 2)


def test_games_are_played_from_one_that_is_known(seen) -> None:
    problem, (observation,), _ = seen()
    start = first_games(problem, observation)[0]
    near = np.stack([start.weights, 0.99 * start.weights + 0.01 * uniform_weights(problem)])
    initial = np.stack([observation.y[0]] * 2)
    batch = play_batch(problem, start, near, initial)
    assert batch.converged.all()
    np.testing.assert_allclose(batch.states[0], observation.y, atol=1e-3)
    assert np.abs(batch.states[1] - batch.states[0]).max() > 1e-5


def test_the_covariance_grows_with_the_noise_and_shrinks_with_trajectories(seen) -> None:
    problem, (observation,), _ = seen(sigma=0.01)
    start = fitted_game(problem, observation)
    one = likelihood_certainty(problem, [observation], [start]).covariance
    size = start.weights.size
    assert one.shape == (size, size)
    np.testing.assert_allclose(one, one.T, atol=1e-12)
    double = likelihood_certainty(replace(problem, sigma=0.02), [observation], [start]).covariance
    np.testing.assert_allclose(double, 4 * one, rtol=1e-6)
    two = likelihood_certainty(problem, [observation] * 2, [start] * 2).covariance
    np.testing.assert_allclose(two, one / 2, rtol=1e-5, atol=1e-9)
    assert (
        likelihood_certainty(replace(problem, sigma=0.0), [observation], [start]).covariance is None
    )


def test_a_quarter_is_two_steps_at_least() -> None:
    assert [forward_model._quarter(np.zeros(n)) for n in (3, 8, 11, 12, 25)] == [2, 2, 2, 3, 6]


def test_the_first_sample_that_is_whole_counts() -> None:
    y = np.zeros((4, 3, 2))
    y[:2, 1, 0] = np.nan
    y[:, 2] = np.nan
    assert forward_model._first_seen(y).tolist() == [0, 2, 0]


def test_hidden_is_what_the_view_does_not_lead_back_to(seen) -> None:
    problem, _, _ = seen()
    assert forward_model.hidden_components(problem) == []
    for names, hidden in ((("px", "py"), [2, 3]), (("py", "speed", "px"), [2])):
        view = ComponentView("some", names)
        assert forward_model.hidden_components(replace(problem, view=view, noise_scale=())) == (
            hidden
        )


def test_a_calm_start_has_means_of_what_is_hidden_only(seen) -> None:
    problem, _, _ = seen(view="partial")
    guess = np.random.default_rng(0).normal(size=(12, 2, 4))
    start = forward_model._calm_start(problem, guess)
    np.testing.assert_array_equal(start[:, :3], guess[0, :, :3])
    np.testing.assert_allclose(start[:, 3], guess[:3, :, 3].mean(axis=0))


def test_noise_on_a_range_and_a_bearing_is_noise_across_and_along(seen) -> None:
    problem, *_ = seen()
    view = RangeBearingView((-9.0, 0.0))
    lidar = replace(problem, view=view, noise_scale=(2.0, 0.5))
    y = np.tile([10.0, 0.0], (5, 2, 1))  # ten metres ahead along x
    noise = forward_model._read_off_noise(lidar, y)
    np.testing.assert_allclose(noise, [[2.0, 5.0, 0, 0]] * 2, rtol=1e-5, atol=1e-9)
    y[:, 1] = np.nan
    lost = forward_model._read_off_noise(lidar, y)
    np.testing.assert_allclose(lost[0], [2.0, 5.0, 0, 0], rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(lost[1, :2], 2.0)


def test_no_covariance_where_weights_are_not_identifiable(seen, monkeypatch) -> None:
    problem, (observation,), _ = seen(sigma=0.01)
    start = fitted_game(problem, observation)

    def fails(*_: object) -> None:
        raise ValueError("no function of them")

    monkeypatch.setattr(certainty, "sample_sensitivity", fails)
    assert likelihood_certainty(problem, [observation], [start]).covariance is None


def test_a_fit_that_does_not_converge_is_no_game(seen, monkeypatch) -> None:
    problem, (observation,), _ = seen(sigma=0.01)
    asked = []

    def unsolved(*given: object) -> object:
        asked.append(given[-1])
        return SimpleNamespace(converged=False)

    assert fitted_game(problem, observation) is not None
    monkeypatch.setattr(forward_model, "solve_joint", unsolved)
    assert fitted_game(problem, observation, 3.0) is None
    (settings,) = asked
    assert settings.tie == 3.0
    assert settings.weight_floor == problem.weight_floor
    assert settings.noise_scale == problem.noise_scale
