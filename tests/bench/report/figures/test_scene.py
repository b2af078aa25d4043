"""The truth behind trials and the plane in which it is drawn."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from olne_bench.bench.report.figures.panels import scene_panels
from olne_bench.bench.report.figures.scene import scene_of
from olne_bench.bench.report.figures.telling import telling_trial
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.envs.scene import PLAYER_COLOURS, player_colour


def test_a_family_shows_one_draw(usual, make_trials):
    scene = scene_of(make_trials("random", ("a",), ("full",), (0.1,), seeds=4), usual)
    assert scene.trials["seed"].tolist() == [telling_trial(scene.trials)[1]]


def test_a_long_road_lies_along_the_page(usual, make_trials, scene):
    road = scene_of(make_trials("highway_overtaking", ("a",), ("full",), (0.1,), 1), usual)
    assert road.is_wide
    assert road.axes_order == (1, 0)
    assert not scene.is_wide


def test_a_fixed_scenario_keeps_all_that_was_attempted(usual, make_trials):
    trials = make_trials(estimators=("a", "b"), sensors=("full",), sigmas=(0.1,), seeds=3)
    trials.loc[trials.index[0], "status"] = "skipped"
    assert len(scene_of(trials, usual).trials) == 5
    with pytest.raises(NotDrawnError, match="nothing was attempted"):
        scene_of(trials.assign(status="skipped"), usual)


@pytest.mark.parametrize("name", ["two_player", "highway_overtaking"])
def test_everything_lies_within_its_limits_with_a_margin(usual, make_trials, name):
    scene = scene_of(make_trials(name, ("a",), ("full",), (0.1,), 1), usual)
    for along, (low, high), extent in zip(
        scene.plane(scene.recording.states), scene.limits, scene.extents, strict=True
    ):
        assert extent == pytest.approx(high - low)
        margins = along.min() - low, high - along.max()
        assert margins[0] == pytest.approx(margins[1])
        assert margins[0] >= 0.12 * np.ptp(along) - 1e-9
        assert margins[0] >= 0.04 * max(scene.extents)


def test_axes_are_named_after_what_they_show(usual, make_trials, scene):
    road = scene_of(make_trials("highway_overtaking", ("a",), ("full",), (0.1,), 1), usual)
    for shown, labels in ((scene, ("px [m]", "py [m]")), (road, ("py [m]", "px [m]"))):
        axes = Figure().add_subplot()
        shown.frame(axes)
        assert (axes.get_xlabel(), axes.get_ylabel()) == labels
        assert (axes.get_xlim(), axes.get_ylim()) == shown.limits
        assert axes.get_aspect() == 1


def test_what_was_observed_has_the_noise_of_its_level_and_seed(scene):
    truth = scene.recording.states
    noise = scene.observed(0.1, 0) - truth
    assert noise.std() == pytest.approx(0.1, rel=0.2)
    assert np.abs(scene.observed(0.1, 1) - scene.observed(0.1, 0)).max() > 0.1
    np.testing.assert_array_equal(scene.observed(0.0, 0), truth)


def test_players_have_a_colour_each_as_long_as_there_are_some():
    count = len(PLAYER_COLOURS)
    assert [player_colour(k) for k in range(count + 1)] == [*PLAYER_COLOURS, PLAYER_COLOURS[0]]


def test_panels_share_their_labels_and_have_the_scenes_shape(scene):
    places = [(0, 0), (0, 1), (1, 1)]
    figure, panels = scene_panels(scene, places, margin=(0.5, 1.0))
    assert len(panels) == len(figure.axes) == 3
    assert [bool(axes.get_xlabel()) for axes in panels] == [True, False, True]
    assert [bool(axes.get_ylabel()) for axes in panels] == [True, False, True]
    for axes, (row, column) in zip(panels, places, strict=True):
        spec = axes.get_subplotspec()
        assert (spec.rowspan.start, spec.colspan.start) == (row, column)
        assert spec.get_gridspec().get_geometry() == (2, 2)
    one, _ = scene_panels(scene, [(0, 0)], margin=(0.5, 1.0))
    width, height = figure.get_size_inches() - one.get_size_inches()  # of a panel and its gap
    assert (width - 0.25) / (height - 0.45) == pytest.approx(scene.extents[0] / scene.extents[1])
    np.testing.assert_allclose(one.get_size_inches() - [width, height], [0.5, 1.0])
