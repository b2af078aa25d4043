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
    assert truth == "truth\nproximity 0.25"  # the speed and the controls have no place
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
