from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import QuadMesh

from olne_bench.bench.report.figures import landscape
from olne_bench.bench.report.figures.scene import scene_of
from olne_bench.bench.report.figures.series import split
from olne_bench.bench.report.not_drawn import NotDrawnError


def test_cost_of_a_position_is_that_of_the_paper(scene):
    # Before the last step only the proximity term depends on the position:
    # 0.1 * theta * -log(d^2 + 0.1), at distance d from the other player.
    states = scene.recording.states
    distances = np.array([0.0, 0.5, 2.0])
    px, py = states[10, 1, 0] + distances, np.full(3, states[10, 1, 1])
    weights = np.array([0.4, 0.2, 0.2, 0.2])
    cost = landscape.position_cost(scene, weights, 10, 0, px, py)
    proximity = -0.1 * 0.4 * np.log(distances**2 + 0.1)
    np.testing.assert_allclose(cost, proximity - proximity[-1], atol=1e-12)


def test_at_the_last_step_the_goal_counts(scene):
    goal = scene.recording.scenario.game.players[0].task[0].goal
    px, py = np.meshgrid(goal[0] + np.linspace(-0.5, 0.5, 11), goal[1] + np.linspace(-0.5, 0.5, 11))
    cost = landscape.position_cost(scene, np.full(4, 0.25), 24, 0, px, py)
    assert np.unravel_index(cost.argmin(), cost.shape) == (5, 5)


def test_closest_pass():
    states = np.zeros((4, 3, 4))
    states[:, 0, 0] = [0, 0, 0, 0]
    states[:, 1, 0] = [0, 5, 4, 6]  # where it starts does not count
    states[:, 2, 0] = [9, 9, 7, 4.5]
    assert landscape.closest_pass(states) == (3, 1)
    assert landscape.closest_pass(states[:, :1]) == (2, 0)


def test_median_over_what_left_weights(make_trials, scene):
    trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.1,), seeds=4)
    rows = [[0.4, 0.2, 0.2, 0.2], [0.1, 0.3, 0.3, 0.3]]
    values = [rows, rows[::-1], None, [[0.4, 0.2, 0.2, 0.2]] * 2]
    trials["weights"] = values
    (series,) = split(trials)
    median = landscape.median_weights(series, scene, 0.1)
    np.testing.assert_allclose(median, [rows[0], [0.4, 0.2, 0.2, 0.2]])


@pytest.mark.parametrize("value", [None, np.nan, [], [[1.0]], "weights", [[np.nan] * 4] * 2])
def test_unusable_weights_leave_no_landscape(usual, make_trials, value):
    trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.1,), seeds=1)
    trials["weights"] = [value] * len(trials)
    expected = "no estimate left weights" if value is None or value is np.nan else "do not fit"
    with pytest.raises(NotDrawnError, match=expected):
        landscape.draw(trials, usual)


def test_titles_tell_the_weights_that_make_a_difference(usual, make_trials):
    trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.1,), seeds=1)
    trials["weights"] = [[[0.4, 0.2, 0.2, 0.2]] * 2]
    truth, other, *_ = titles(landscape.draw(trials, usual))
    assert (
        truth == "truth\nproximity 0.25"
    )  # the costs of speed and controls do not depend on the position
    assert other == "a\nproximity 0.4"


def titles(figure):
    return [axes.get_title() for axes in figure.axes]


@pytest.mark.parametrize("name", ["two_player", "highway_overtaking"])
def test_costs_lie_where_they_are_and_a_star_marks_whose_they_are(usual, make_trials, name):
    trials = make_trials(name, ("a",), ("full",), (0.1,), 1)
    scene = scene_of(trials, usual)
    figure = landscape.draw(trials, usual)
    step, player = landscape.closest_pass(scene.recording.states)
    position = scene.recording.states[step, player]
    panels = [axes for axes in figure.axes if axes.get_title()]
    assert len(panels) == 2  # the truth's and the estimate's
    for axes in panels:
        (star,) = [line for line in axes.lines if line.get_marker() == "*"]
        np.testing.assert_allclose(star.get_xydata(), [scene.plane(position)])
        (mesh,) = [one for one in axes.collections if isinstance(one, QuadMesh)]
        places = mesh.get_coordinates()
        for axis, (low, high) in enumerate(scene.limits):
            cell = (high - low) / (places.shape[1 - axis] - 2)
            assert places[..., axis].min() == pytest.approx(low - cell / 2, abs=1e-9)
            assert places[..., axis].max() == pytest.approx(high + cell / 2, abs=1e-9)
    true = panels[0].collections[0]
    assert isinstance(true, QuadMesh)
    middles = (true.get_coordinates()[:-1, :-1] + true.get_coordinates()[1:, 1:]) / 2
    right, up = np.moveaxis(middles, -1, 0)
    px, py = (right, up) if scene.axes_order == (0, 1) else (up, right)
    weights = scene.recording.scenario.weights[player]
    expected = landscape.position_cost(scene, weights, step, player, px, py)
    np.testing.assert_allclose(true.get_array().reshape(px.shape), expected, atol=1e-6)


@pytest.fixture(scope="module")
def figure(usual, make_trials):
    """A figure of the truth, two estimators and the floor, which is left out."""
    trials = make_trials(estimators=("a", "b", "uniform"), sigmas=(0.01, 0.1), seeds=2)
    return landscape.draw(trials, usual)


def test_panels_stand_in_rows_of_three_with_one_bar_of_colours(figure):
    *panels, bar = figure.axes
    assert [axes.get_title().split("\n")[0] for axes in panels] == ["truth", "a", "b"]
    assert panels[0].get_gridspec().get_geometry() == (1, 3)
    assert bar.get_ylabel() == "Cost above the least [-]"
    assert "σ = 0.1" in figure.get_suptitle() and "(full, " in figure.get_suptitle()


def test_the_time_and_the_player_of_the_closest_pass_are_told(figure, scene):
    step, player = landscape.closest_pass(scene.recording.states)
    time = step * scene.recording.scenario.game.dt
    assert f"for player {player + 1} at t = {time:g} s" in figure.get_suptitle()


def test_all_panels_have_one_scale_from_nothing_to_the_largest_cost(figure):
    meshes = [one for axes in figure.axes for one in axes.collections if isinstance(one, QuadMesh)][
        :3
    ]
    largest = max(mesh.get_array().max() for mesh in meshes)
    assert all(mesh.get_clim() == (0, pytest.approx(largest)) for mesh in meshes)
    assert all(mesh.get_array().min() == 0 for mesh in meshes)
    rows, columns = np.array(meshes[0].get_array()).shape
    assert max(rows, columns) == 160


def test_contours_are_level_between_the_ends_of_the_scale(figure):
    axes = figure.axes[0]
    contours = next(one for one in axes.collections if hasattr(one, "levels"))
    mesh = next(one for one in axes.collections if isinstance(one, QuadMesh))
    largest = mesh.get_clim()[1]
    np.testing.assert_allclose(contours.levels, np.linspace(0, largest, 11)[1:-1])


def test_a_star_is_larger_than_a_dot_and_paths_are_thin(figure):
    axes = figure.axes[0]
    marked = {line.get_marker(): line for line in axes.lines if len(line.get_xdata()) == 1}
    assert set(marked) == {"*", "o"}
    assert marked["*"].get_markersize() > 1.5 * marked["o"].get_markersize()
    assert {line.get_markeredgecolor() for line in marked.values()} == {"white"}
    paths = [line for line in axes.lines if len(line.get_xdata()) > 1]
    assert len(paths) == 2
    assert all(0.5 < line.get_linewidth() < 1 and line.get_color() == "white" for line in paths)


def test_the_legend_says_whose_cost_it_is(figure):
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [
        "player 1 (whose cost)",
        "player 2",
    ]
    assert [line.get_marker() for line in legend.get_lines()] == ["*", "o"]


@pytest.mark.parametrize("wide", [False, True])
def test_cells_are_square_and_a_narrow_slice_has_some_all_the_same(scene, wide):
    height = 0.05 if wide else 3.0
    px, py = landscape._grid(replace(scene, limits=((-3.0, 3.0), (-height / 2, height / 2))))
    assert px.shape == py.shape == ((12, 160) if wide else (80, 160))
    np.testing.assert_allclose([px.min(), px.max()], [-3, 3])
    np.testing.assert_allclose([py.min(), py.max()], [-height / 2, height / 2])
    turned = replace(scene, limits=((-3.0, 3.0), (-1.5, 1.5)), axes_order=(1, 0))
    px, py = landscape._grid(turned)
    np.testing.assert_allclose([py.min(), py.max(), px.min(), px.max()], [-3, 3, -1.5, 1.5])


def test_colours_of_a_road_end_at_the_largest_cost_near_the_player(scene):
    right, up = np.meshgrid(np.linspace(-10, 10, 41), np.linspace(-10, 10, 41))
    x, y = scene.recording.states[5, 1, :2]
    distance = np.hypot(right - x, up - y)
    costs = [distance, 2 * distance]
    assert landscape._largest(scene, costs, right, up, 5, 1) == 2 * distance.max()
    scenario = replace(scene.recording.scenario, world="highway_v0")
    road = replace(scene, recording=replace(scene.recording, scenario=scenario))
    found = landscape._largest(road, costs, right, up, 5, 1)
    assert found == 2 * distance[distance < 3.5].max()


def test_the_largest_level_at_which_all_left_weights_is_taken(make_trials, scene):
    trials = make_trials(estimators=("a", "b"), sensors=("full",), sigmas=(0.01, 0.05, 0.1))
    assert landscape._common_sigma(split(trials), scene) == 0.1
    trials["weights"] = trials["weights"].where(
        (trials["estimator"] == "a") | (trials["sigma"] < 0.1), None
    )
    assert landscape._common_sigma(split(trials), scene) == 0.05
    trials["weights"] = trials["weights"].where(trials["estimator"] == "a", None)
    assert landscape._common_sigma(split(trials), scene) == 0.1


def test_weights_that_matter_at_the_end_are_others(scene):
    names = scene.recording.scenario.game.weight_names
    last = len(scene.recording.states) - 1
    for step in (10, last):
        assert [names[k] for k in landscape._weights_that_matter(scene, step, 0)] == ["proximity"]
    told = landscape._told(scene, np.array([0.456, 0.1, 0.1, 0.1]), [0, 2])
    assert told == "proximity 0.46, acceleration 0.1"
