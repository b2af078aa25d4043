"""Predictions from the samples so far that know no weights."""

import numpy as np
import pytest

from olne_bench.bench.judge.predictions import (
    drive_as_fitted,
    drive_as_stock,
    drive_on,
    turn_on,
)
from olne_bench.envs.scenarios.highway import propose
from olne_bench.estimators.protocol import Problem
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.observation import VIEWS

SEEN = 8


@pytest.fixture(scope="module")
def motion() -> tuple[Problem, np.ndarray]:
    """Two cars on a highway that accelerate and brake, seen without noise."""
    scenario = propose(np.random.default_rng(2), 2)
    game = scenario.game
    controls = np.zeros((game.horizon - 1, *game.control_shape[1:]))
    controls[:, :, 1] = [1.0, -0.5]  # [m/s^2]
    start = np.array([[100.0, 0.0, 0.0, 24.0], [140.0, 8.0, 0.0, 26.0]])  # two lanes apart
    states = rollout(game.dynamics, start, controls, game.dt)
    return Problem(game, VIEWS["full"], 0.1, noise_scale=scenario.noise_scale), states


def test_held_controls_are_those_of_the_last_samples(motion) -> None:
    problem, states = motion
    found = turn_on(problem, states[:SEEN])
    assert found.shape == states.shape
    np.testing.assert_allclose(found[SEEN:, :, :2], states[SEEN:, :, :2], atol=0.5)
    ahead = drive_on(problem, states[:SEEN])
    assert np.linalg.norm(ahead[-1, 0, :2] - states[-1, 0, :2]) > 5.0
    np.testing.assert_allclose(ahead[SEEN:, :, 3], ahead[[SEEN], :, 3].repeat(12, axis=0))


@pytest.mark.parametrize("count", [1, 2, SEEN, 20])
def test_every_number_of_samples_has_a_prediction(motion, count) -> None:
    problem, states = motion
    for found in (
        drive_on(problem, states[:count]),
        turn_on(problem, states[:count]),
        drive_as_stock("highway", problem, states[:count]),
    ):
        assert found.shape == states.shape
        assert np.isfinite(found).all()


def test_stock_drivers_keep_their_present_speed(motion) -> None:
    problem, states = motion
    found = drive_as_stock("highway", problem, states[:SEEN])
    alone = int(states[SEEN - 1, :, 0].argmax())  # nobody is ahead of it
    np.testing.assert_allclose(found[SEEN:, alone, 3], found[SEEN - 1, alone, 3], atol=0.5)


def test_fitted_drivers_drive_on_from_what_was_seen(motion) -> None:
    problem, states = motion
    assert drive_as_fitted("highway", problem, states[:1]) is None
    whole = drive_as_fitted("highway", problem, states[:4])
    assert whole is not None and whole.shape == states.shape
    ahead = np.linalg.norm((whole - states)[4:6, 0, :2], axis=-1)  # the other one changes lanes
    assert ahead.max() < 1.0
    seen = states[:4].copy()
    seen[2, 1] = np.nan  # it was not seen for a while
    with_gap = drive_as_fitted("highway", problem, seen)
    assert with_gap is not None and np.isfinite(with_gap).all()
    np.testing.assert_allclose(with_gap[4:6], whole[4:6], atol=1.0)
