"""Predictions from held-out starts, and of what follows a motion."""

import json

import numpy as np
import pytest

from olne_bench.bench.judge.truth import Draw, ahead, held_out, held_out_samples, true_recording

DRAW = Draw("two_player", "{}", 1, 0)
AGAIN = {"of": "two_player", "change": "replanning", "dial": 0.5}
PLAN_AGAIN = Draw("changed", json.dumps(AGAIN), 1, 0)
OTHER = np.array([[0.4, 0.2, 0.2, 0.2], [0.3, 0.3, 0.2, 0.2]])


def error_ahead(draw: Draw, theta: np.ndarray, seconds: float) -> float:
    """Largest error of the positions that weights predict [m]."""
    found = ahead(draw, theta, seconds)
    assert found is not None
    follows, foreseen = found
    last = true_recording(draw).states[-1]
    steps = round(seconds / true_recording(draw).scenario.game.dt)
    assert follows.shape == foreseen.shape == (steps + 1, *last.shape)
    for states in found:
        np.testing.assert_array_equal(states[0], last)
    return float(np.abs(follows - foreseen)[-1, :, :2].max())


def test_samples_predict_like_estimates_of_the_same_weights() -> None:
    estimate = np.full((2, 4), 0.25)
    samples = held_out_samples(DRAW, estimate, np.stack([estimate, OTHER]), 100)
    assert samples is not None and np.isfinite(samples).all()
    for column, theta in enumerate((estimate, OTHER)):
        pairs = held_out(DRAW, theta, 100)
        assert pairs is not None
        for one, predictions in zip(pairs, samples, strict=True):
            np.testing.assert_allclose(predictions[column], one.prediction, atol=1e-7)
    assert not np.allclose(samples[:, 0], samples[:, 1], atol=1e-3)


@pytest.mark.parametrize("seconds", [0.5, 2.0, 12.0])
def test_true_weights_know_what_follows(seconds: float) -> None:
    theta = true_recording(DRAW).scenario.theta
    assert error_ahead(DRAW, theta, seconds) < 1e-9
    assert error_ahead(DRAW, OTHER, seconds) > 1e-4


@pytest.mark.parametrize("seconds", [0.5, 1.0])
def test_true_weights_know_it_best_of_players_that_plan_again(seconds: float) -> None:
    """They plan as far as before, so a plan for the time that is asked for would be another."""
    theta = true_recording(PLAN_AGAIN).scenario.theta
    own, other = (error_ahead(PLAN_AGAIN, one, seconds) for one in (theta, OTHER))
    assert own < other / 5
