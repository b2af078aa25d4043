import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.judge.metrics.formulas import position_error
from olne_bench.bench.judge.truth import Draw, predict_from_start, true_recording
from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.predicted_motion import estimated_weights, predict_again

DRAW = Draw.of(ScenarioEntry(name="two_player"), 0, "test")


def scored(weights: np.ndarray) -> dict:
    """The row of a trial, as the benchmark scores one."""
    prediction = predict_from_start(DRAW, weights, 300)
    assert prediction.root is not None
    error = position_error(true_recording(DRAW).states, prediction.root.states)
    return {
        "seed": 0,
        "status": "ok",
        "weights": weights.tolist(),
        "published_forward": float(prediction.published),
        "position_error": error,
    }


@pytest.mark.parametrize("spread", [0.1, 1.0, 2.0])
def test_a_replay_is_the_motion_that_was_scored(spread):
    rng = np.random.default_rng(3)
    weights = rng.dirichlet(np.full(4, 1 / spread), 2)
    row = scored(weights)
    states = predict_again(DRAW, row)
    assert states is not None
    assert position_error(true_recording(DRAW).states, states) == pytest.approx(
        row["position_error"], rel=1e-3, abs=1e-5
    )


def test_another_motion_than_that_scored_is_not_shown():
    row = scored(np.full((2, 4), 0.25))
    assert predict_again(DRAW, row | {"position_error": row["position_error"] + 0.3}) is None


def test_failures_have_no_replay():
    row = scored(np.full((2, 4), 0.25))
    assert predict_again(DRAW, row | {"status": "failed_forward"}) is None
    assert predict_again(DRAW, row | {"weights": None}) is None


def test_a_motion_is_known_by_its_error_to_a_micrometre_and_a_ten_thousandth():
    """The error of a motion that is found again may differ by rounding only."""
    row = scored(np.array([[0.1, 0.2, 0.3, 0.4], [0.4, 0.3, 0.2, 0.1]]))
    error = row["position_error"]
    assert error > 1e-3
    for off, known in ((0.5, True), (-0.5, True), (1.5, False), (-1.5, False)):
        told = error + off * (1e-6 + 1e-4 * error)
        assert (predict_again(DRAW, row | {"position_error": told}) is not None) == known


@pytest.mark.parametrize("value", [None, float("nan"), pd.NA])
def test_no_weights_are_none(value):
    assert estimated_weights(value, true_recording(DRAW).scenario.game) is None


def test_weights_of_another_game_are_refused():
    game = true_recording(DRAW).scenario.game
    rows = np.array([[0.1, 0.2, 0.3, 0.4], [0.5, 0.1, 0.2, 0.2]])
    np.testing.assert_array_equal(estimated_weights(rows.tolist(), game), rows)
    for wrong in (rows[:1].tolist(), 3.0, [["a"] * 4] * 2):
        with pytest.raises(NotDrawnError, match="stored weights do not fit the scenario"):
            estimated_weights(wrong, game)
