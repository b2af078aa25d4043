"""Roads in figures: as HighwayEnv draws them."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from olne_bench.bench.report.figures import landscape, style, trajectories
from olne_bench.bench.report.figures.scene import scene_of


@pytest.fixture(scope="module")
def scene(road_trials, road_study):
    return scene_of(road_trials, road_study)


def test_cars_lie_as_in_highway_envs_own_picture(scene, road_frame):
    axes = Figure(figsize=(5, 5)).add_subplot()
    scene.frame(axes)
    axes.apply_aspect()
    starts = scene.recording.states[0, :, :2]
    drawn = axes.transData.transform(starts)  # upwards
    across, down = (drawn[0] - drawn[1]) * (1, -1)
    theirs = road_frame[1][0] - road_frame[1][1]
    assert np.abs(theirs).min() > 20  # pixels: neither axis can hide its direction
    np.testing.assert_allclose(
        np.array([across, down]) / np.hypot(across, down), theirs / np.hypot(*theirs), atol=0.02
    )


def test_every_car_is_on_a_lane_and_in_its_own_direction(scene):
    axes = Figure().add_subplot()
    scene.frame(axes)
    (asphalt, *marks) = axes.collections
    lanes = asphalt.get_paths()
    assert len(lanes) == len(scene.lanes) > 8
    assert len(marks) == 2  # solid and dashed lines
    for state in scene.recording.states[0]:
        assert any(lane.contains_point(state[:2]) for lane in lanes)
        scene.draw_car(axes, state, "black")
        corners = axes.patches[-1].get_xy()[:4]
        sides = np.linalg.norm(np.diff(corners, axis=0), axis=1)
        np.testing.assert_allclose(sides, [5, 2, 5], atol=1e-9)
        np.testing.assert_allclose(corners.mean(axis=0), state[:2], atol=1e-9)
        along = corners[1] - corners[0]
        np.testing.assert_allclose(along / 5, [np.cos(state[2]), np.sin(state[2])], atol=1e-9)


def test_figures_of_a_road_point_down_and_have_cars(road_trials, road_study):
    with style.applied():
        bundles = trajectories.draw(road_trials, road_study)
        heat = landscape.draw(road_trials, road_study)
    for axes in [*bundles.axes, *heat.axes[:-1]]:  # the last one is the bar of colours
        assert axes.yaxis_inverted()
        assert any(isinstance(patch, Polygon) for patch in axes.patches)
    assert "uniform" not in " ".join(axes.get_title() for axes in heat.axes)


def test_the_landscape_of_a_road_stays_where_its_lane_is_defined(road_trials, road_study):
    """Opposite to the middle of an arc the lane's heading jumps, which looked like a wedge."""
    axes = landscape.draw(road_trials, road_study).axes[0]
    (left, right), (bottom, top) = axes.get_xlim(), sorted(axes.get_ylim())
    assert right - left <= 36.001
    assert top - bottom <= 36.001


def test_scenarios_of_the_paper_point_up(make_trials, usual):
    axes = Figure().add_subplot()
    scene = scene_of(make_trials(seeds=1, sigmas=(0.1,)), usual)
    scene.frame(axes)
    assert not axes.yaxis_inverted()
    assert not scene.lanes
    scene.draw_car(axes, scene.recording.states[0, 0], "black")
    assert not axes.patches
