"""Scenes: truths, observations, predictions, and the rule that chooses what is shown."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.report.formats import NotDrawnError
from olne_bench.bench.report.scenes import (
    choose,
    estimated_weights,
    scene_of,
    sequences,
    shown_trial,
)
from olne_bench.bench.submission.played import PlayedScenes

DRAWS = 9


def test_failures_and_what_the_published_step_does_not_find_have_no_replay(usual):
    scene = scene_of("two_player", 0, usual)
    row = {"scenario": "two_player", "seed": 0, "status": "ok", "published_forward": 1}
    row |= {"weights": [[0.25] * 4] * 2}
    states = scene.predicted(row)
    assert states is not None and states.shape == scene.truth.states.shape
    for change in ({"status": "failed_forward"}, {"published_forward": 0}):
        assert scene.predicted(row | change) is None


@pytest.mark.parametrize("value", [None, float("nan"), pd.NA])
def test_no_weights_are_none(usual, value):
    assert estimated_weights(value, usual.scenes.truth("two_player", 0)) is None


def test_weights_of_another_game_are_refused(usual):
    truth = usual.scenes.truth("two_player", 0)
    rows = np.array([[0.1, 0.2, 0.3, 0.4], [0.5, 0.1, 0.2, 0.2]])
    np.testing.assert_array_equal(estimated_weights(rows.tolist(), truth), rows)
    for wrong in (rows[:1].tolist(), 3.0, [["a"] * 4] * 2, (-rows).tolist(), [[np.nan] * 4] * 2):
        with pytest.raises(NotDrawnError, match="stored weights do not fit the scenario"):
            estimated_weights(wrong, truth)


def test_a_scene_that_is_not_stored_says_so():
    with pytest.raises(NotDrawnError, match="its truth is not stored here"):
        scene_of("two_player", 0)


@pytest.mark.parametrize("name", ["two_player", "highway_overtaking"])
def test_everything_lies_within_its_limits_with_a_margin(usual, name):
    scene = scene_of(name, 0, usual)
    assert scene.is_wide == (name != "two_player")
    assert scene.axis_names == (("py", "px") if scene.is_wide else ("px", "py"))
    for along, (low, high) in zip(scene.plane(scene.truth.states), scene.limits, strict=True):
        margins = along.min() - low, high - along.max()
        assert margins[0] == pytest.approx(margins[1])
        assert margins[0] >= 0.12 * np.ptp(along) - 1e-9
        assert margins[0] >= 0.04 * max(scene.extents)


def test_what_was_observed_has_the_noise_of_its_level_and_seed(usual):
    scene = scene_of("two_player", 0, usual)
    truth = scene.truth.states
    assert (scene.observed(0.1, 0) - truth).std() == pytest.approx(0.1, rel=0.2)
    assert np.abs(scene.observed(0.1, 1) - scene.observed(0.1, 0)).max() > 0.1
    np.testing.assert_array_equal(scene.observed(0.0, 0), truth)


@pytest.mark.parametrize(
    ("height", "stretch"), [(20.0, 1.0), (10.0, 1.0), (6.0, 1.5), (5.0, 2.0), (1.0, 3.0)]
)
def test_a_long_road_is_stretched_across(usual, road_study, height, stretch):
    limits = ((-30.0, 30.0), (-height / 2, height / 2))
    road = replace(scene_of("roundabout", 0, road_study), limits=limits)
    assert road.on_road and len(road.lanes) > 8
    assert road.stretch == stretch
    assert road.is_wide == (2 * height < 60)
    assert replace(scene_of("two_player", 0, usual), limits=limits).stretch == 1


def attempts(failed: tuple[int, ...] = (), **errors: float) -> pd.DataFrame:
    """Trials at two levels and two sensors; at the larger level ``bad`` fails in some draws."""
    rows = [
        {
            "scenario": "road",
            "sensor": sensor,
            "sigma": sigma,
            "seed": seed,
            "estimator": name,
            "count": 1,
            "position_error": error * (1 + seed),
            "status": "ok",
            "published_forward": 1,
        }
        for name, error in ({"good": 0.1, "bad": 3.0, "uniform": 0.01} | errors).items()
        for sensor in ("full", "partial")
        for sigma in (0.1, 0.5)
        for seed in range(DRAWS)
    ]
    table = pd.DataFrame(rows)
    lost = (table["estimator"] == "bad") & table["seed"].isin(failed) & (table["sigma"] == 0.5)
    lost |= (table["estimator"] == "bad") & (table["sensor"] == "partial")
    table.loc[lost, "status"] = "failed_forward"
    table.loc[lost, "position_error"] = np.nan
    return table


def test_the_best_meets_the_papers_method_or_the_next_one():
    assert choose(attempts(fair=0.11)).estimators == ("good", "fair")
    assert choose(attempts(fair=0.11, kkt_constrained=0.5)).estimators[1] == "kkt_constrained"
    assert choose(attempts(kkt_constrained=0.05)).estimators == ("kkt_constrained", "good")


@pytest.mark.parametrize(
    ("failed", "sigma", "draws"), [((), 0.5, 9), ((0, 1, 2, 8), 0.5, 5), (range(7), 0.1, 9)]
)
def test_the_noise_is_the_largest_that_both_predict_in_half_of_the_draws(failed, sigma, draws):
    choice = choose(attempts(tuple(failed)))
    assert (choice.estimators, choice.sensor, choice.sigma) == (("good", "bad"), "full", sigma)
    assert len(choice.seeds) == draws


def test_the_median_difference_comes_first():
    choice = choose(attempts((0, 1)))
    assert choice.seeds[0] == 5  # the differences of draws 2 to 8 grow with the draw
    assert set(choice.seeds[1:3]) == {4, 6}


def test_what_cannot_be_chosen_is_said():
    table = attempts()
    with pytest.raises(NotDrawnError, match="two estimators"):
        choose(table[table["estimator"].isin(["good", "uniform"])])
    with pytest.raises(NotDrawnError, match="no trial in common"):
        choose(table.assign(published_forward=0))
    with pytest.raises(NotDrawnError, match="nothing was attempted"):
        sequences(table.assign(status="skipped"), 3)


def test_sequences_are_the_chosen_one_the_wanted_and_those_of_its_draw():
    places, shown = sequences(attempts(), 2, [(0.1, 8), (0.1, 99)])
    assert places == [(0.5, 4), (0.1, 8)] and shown == ["good", "bad"]
    places, _ = sequences(attempts(), 9)
    assert places == [(0.5, 4), (0.1, 4)]


def test_a_trial_is_shown_with_both_predictions_or_not_at_all(road_trials, road_study):
    choice = choose(road_trials, road_study)
    seed, scene, rows, found = shown_trial(road_trials, choice, road_study)
    assert seed == 0 and [row["estimator"] for row in rows] == [*choice.estimators]
    np.testing.assert_allclose(found[0], scene.truth.states, atol=1e-4)
    lost = replace(road_study, scenes=PlayedScenes(road_study))
    with pytest.raises(NotDrawnError, match="predictions of the chosen trials are not stored"):
        shown_trial(road_trials, choice, lost)
