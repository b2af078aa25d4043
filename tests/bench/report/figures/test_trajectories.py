"""Bundles of predicted trajectories."""

import numpy as np

from olne_bench.bench.report.figures import trajectories
from olne_bench.bench.report.figures.scene import scene_of
from olne_bench.bench.report.figures.series import contenders, split


def titles(figure):
    return [axes.get_title() for axes in figure.axes]


def test_bundles_say_how_many_failed(usual, make_trials):
    trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.01, 0.1), seeds=3)
    last = trials.index[-1]
    trials.loc[last, "status"] = "failed_forward"
    figure = trajectories.draw(trials, usual)
    assert titles(figure) == [
        "Truth and 3 observed sequences",
        "a\nfull, 1 of 3 failed",
    ]
    # Truth and start per player, and the two predictions of each with their ends.
    assert len(figure.axes[1].lines) == 2 * 2 + 2 * 2 * 2


def test_bundles_are_of_the_largest_noise_at_which_everybody_predicts_something(usual, make_trials):
    trials = make_trials(estimators=("a", "b"), sensors=("full",), sigmas=(0.01, 0.1))
    assert trajectories.draw(trials, usual).get_suptitle().endswith("σ = 0.1")
    lost = (trials["estimator"] == "b") & (trials["sigma"] == 0.1)
    trials.loc[lost, "status"] = "failed_forward"
    assert trajectories.draw(trials, usual).get_suptitle().endswith("σ = 0.01")
    trials["status"] = "failed_forward"
    assert trajectories.draw(trials, usual).get_suptitle().endswith("σ = 0.1")


def test_prediction_at_the_true_weights_is_the_truth(usual, make_trials, scene):
    trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.1,), seeds=1)
    trials["weights"] = [scene.recording.scenario.weights.tolist()]
    predicted = trajectories.draw(trials, usual).axes[1].lines[0].get_xydata()
    np.testing.assert_allclose(predicted, scene.recording.states[:, 0, :2], atol=1e-6)


def test_one_sequence_is_one_and_its_observations_are_points(usual, make_trials, scene):
    trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.1,), seeds=1)
    first = trajectories.draw(trials, usual).axes[0]
    assert first.get_title() == "Truth and 1 observed sequence"
    points = [line.get_xydata() for line in first.lines if line.get_marker() == "."]
    observed = scene.observed(0.1, 0)[..., :2]
    np.testing.assert_allclose(points, observed.swapaxes(0, 1))
    dashed = [line.get_xydata() for line in first.lines if line.get_linestyle() == "--"]
    np.testing.assert_allclose(dashed, scene.recording.states[..., :2].swapaxes(0, 1))


def test_what_is_not_found_again_is_said(usual, make_trials):
    trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.1,), seeds=3)
    trials.loc[trials.index[0], "position_error"] += 1.0
    said = titles(trajectories.draw(trials, usual))[1]
    assert said == "a\nfull, 0 of 3 failed\n1 not drawn"


def places(trials, usual):
    """Of the panels, (row, column) by estimator and sensor."""
    scene = scene_of(trials, usual)
    series = contenders(split(trials, usual))
    found = trajectories._places(scene, series)
    return {(s.estimator, s.sensor): place for s, place in zip(series, found, strict=True)}


def test_panels_are_a_row_per_estimator_and_a_column_per_sensor(usual, make_trials):
    trials = make_trials(estimators=("b", "a"), sigmas=(0.1,), seeds=1)
    assert places(trials, usual) == {
        ("a", "full"): (0, 1),
        ("a", "partial"): (0, 2),
        ("b", "full"): (1, 1),
        ("b", "partial"): (1, 2),
    }


def test_panels_of_one_sensor_follow_each_other(usual, make_trials):
    trials = make_trials(estimators=tuple("abcd"), sensors=("full",), sigmas=(0.1,), seeds=1)
    found = places(trials, usual)
    assert [found[name, "full"] for name in "abcd"] == [(0, 1), (0, 2), (1, 0), (1, 1)]


def test_panels_of_a_long_road_lie_below_each_other(usual, make_trials):
    trials = make_trials("highway_overtaking", ("a", "b"), ("full",), (0.1,), 1)
    assert sorted(places(trials, usual).values()) == [(1, 0), (2, 0)]
