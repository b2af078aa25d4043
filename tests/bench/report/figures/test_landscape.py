import numpy as np
import pytest

from olne_bench.bench.report.figures import landscape, trajectories
from olne_bench.bench.report.figures.scene import scene_of
from olne_bench.bench.report.figures.series import split
from olne_bench.bench.report.figures.telling import telling_trial
from olne_bench.bench.report.not_drawn import NotDrawnError


@pytest.fixture(scope="module")
def scene(make_trials, usual):
    return scene_of(make_trials(), usual)


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


def test_prediction_at_the_true_weights_is_the_truth(usual, make_trials, scene):
    trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.1,), seeds=1)
    trials["weights"] = [scene.recording.scenario.weights.tolist()]
    predicted = trajectories.draw(trials, usual).axes[1].lines[0].get_xydata()
    np.testing.assert_allclose(predicted, scene.recording.states[:, 0, :2], atol=1e-6)


def test_a_family_shows_one_draw(usual, make_trials):
    scene = scene_of(make_trials("random", ("a",), ("full",), (0.1,), seeds=4), usual)
    assert scene.trials["seed"].tolist() == [telling_trial(scene.trials)[1]]


def test_a_long_road_lies_along_the_page(usual, make_trials, scene):
    road = scene_of(make_trials("highway_overtaking", ("a",), ("full",), (0.1,), 1), usual)
    assert road.is_wide
    assert road.axes_order == (1, 0)
    assert not scene.is_wide
