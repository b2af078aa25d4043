"""The figure of one trial."""

import numpy as np
import pytest
from matplotlib.patches import Polygon

from olne_bench.bench.report.figures import style, trial
from olne_bench.bench.report.scenes import scene_of


def test_truth_observations_and_two_predictions_on_a_road(road_trials, road_study) -> None:
    with style.applied():
        figure = trial.draw(road_trials, road_study)
    first, *others = figure.axes
    assert len(others) == 2 and all(axes.yaxis_inverted() for axes in figure.axes)
    assert "roundabout, draw 0: σ = 0.1 m, sensor full" in figure.get_suptitle()
    scene = scene_of("roundabout", 0, road_study)
    points = [line.get_xydata() for line in first.lines if line.get_marker() == "."]
    np.testing.assert_allclose(points, scene.observed(0.1, 0)[..., :2].swapaxes(0, 1))
    truth = scene.truth.states[..., :2].swapaxes(0, 1)
    for axes in others:  # the estimates are true
        assert "predicts, 0 m off" in axes.get_title()
        motion = [line.get_xydata() for line in axes.lines if line.get_linewidth() == 2]
        np.testing.assert_allclose(motion, truth, atol=1e-5)


def test_cars_are_on_lanes_with_their_size_and_direction(road_trials, road_study) -> None:
    scene = scene_of("roundabout", 0, road_study)
    axes = trial.draw(road_trials, road_study).axes[0]
    asphalt, *marks = axes.collections
    assert len(asphalt.get_paths()) == len(scene.lanes) > 8
    assert len(marks) == 2  # solid and dashed lines
    cars = [patch for patch in axes.patches if isinstance(patch, Polygon)]
    for state, car in zip(scene.truth.states[0], cars[::2], strict=True):
        assert any(lane.contains_point(state[:2]) for lane in asphalt.get_paths())
        corners = car.get_xy()[:4]
        np.testing.assert_allclose(corners.mean(axis=0), state[:2], atol=1e-9)
        along = corners[1] - corners[0]
        np.testing.assert_allclose(along / 5, [np.cos(state[2]), np.sin(state[2])], atol=1e-9)


@pytest.mark.parametrize(("name", "labels"), [("two_player", ("px [m]", "py [m]"))])
def test_scenarios_of_the_paper_point_up_and_have_dots(make_trials, usual, name, labels) -> None:
    axes = trial.draw(make_trials(name, seeds=1, sigmas=(0.1,)), usual).axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == labels
    assert not axes.yaxis_inverted() and not axes.patches and axes.get_aspect() == 1


def test_a_long_road_has_panels_below_each_other(make_trials, usual) -> None:
    trials = make_trials("highway_overtaking", seeds=1, sigmas=(0.1,), sensors=("full",))
    places = [axes.get_position() for axes in trial.draw(trials, usual).axes]
    assert places[0].y0 > places[1].y0 > places[2].y0
