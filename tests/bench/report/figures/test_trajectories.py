"""Bundles of predicted trajectories."""

import numpy as np
import pandas as pd

from olne_bench.bench.report.figures import trajectories
from olne_bench.bench.report.figures.scene import scene_of
from olne_bench.bench.report.figures.series import contenders, split
from olne_bench.envs.worlds.scene import player_colour


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
    """Places of the panels, (row, column) by estimator and sensor."""
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


def test_lines_of_few_predictions_are_strong_and_the_truth_stays_thin(usual, make_trials):
    looks = []
    for seeds in (4, 5):
        trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.1,), seeds=seeds)
        panel = trajectories.draw(trials, usual).axes[1]
        truth = [line for line in panel.lines if line.get_linestyle() == "--"]
        solid = [
            line
            for line in panel.lines
            if line.get_linestyle() == "-" and len(line.get_xdata()) > 1
        ]
        assert len(truth) == 2 and len(solid) == 2 * seeds
        assert all(line.get_color() == "black" for line in truth)
        looks.append((solid[0].get_linewidth(), solid[0].get_alpha()))
        assert solid[0].get_linewidth() > 0.7 * truth[0].get_linewidth()
    few, many = looks
    assert few[0] > many[0] and few[1] > 1.5 * many[1]
    assert truth[0].get_linewidth() < few[0]


def test_the_legend_names_the_truth_and_every_player(usual, make_trials):
    trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.1,), seeds=1)
    (legend,) = trajectories.draw(trials, usual).legends
    names = [text.get_text() for text in legend.get_texts()]
    assert names == ["truth, numbered where it starts", "player 1", "player 2"]
    truth, *players = legend.get_lines()
    assert truth.get_color() == "black" and truth.get_marker() == "o"
    assert [line.get_color() for line in players] == [player_colour(k) for k in (0, 1)]


def test_forty_sequences_are_shown_at_most(usual, make_trials):
    trials = make_trials(estimators=("uniform",), sensors=("full",), sigmas=(0.1,), seeds=1)
    many = pd.concat([trials.assign(seed=k) for k in range(41)], ignore_index=True)
    many["status"] = "crash"
    first, second = trajectories.draw(many, usual).axes
    assert first.get_title() == "Truth and 40 observed sequences"
    assert second.get_title() == "uniform\nfull, 40 of 40 failed"
