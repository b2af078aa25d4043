"""The truth behind trials and the plane in which it is drawn."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from olne_bench.bench.report.figures.panels import scene_panels
from olne_bench.bench.report.figures.scene import scene_of
from olne_bench.bench.report.figures.telling import telling_trial
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.envs.roads.road_shapes import LaneShape
from olne_bench.envs.worlds.scene import PLAYER_COLOURS, player_colour


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


@pytest.fixture
def road(scene):
    """The two players as cars, on 60 m by 20 m of a road with two lanes."""
    scenario = replace(scene.recording.scenario, world="highway_v0")
    x = np.linspace(-30.0, 30.0, 5)
    edges = [np.column_stack([x, np.full(5, y)]) for y in (-4.0, 0.0, 4.0)]
    lanes = (
        LaneShape((edges[0], edges[1]), ("solid", "dashed")),
        LaneShape((edges[1], edges[2]), ("none", "solid")),
    )
    return replace(
        scene,
        recording=replace(scene.recording, scenario=scenario),
        axes_order=(0, 1),
        limits=((-30.0, 30.0), (-10.0, 10.0)),
        lanes=lanes,
    )


def test_a_road_has_asphalt_marks_and_an_ordinate_that_points_down(road):
    axes = Figure().add_subplot()
    road.frame(axes)
    assert axes.get_xlim() == road.limits[0]
    assert axes.get_ylim() == road.limits[1][::-1]
    asphalt, solid, dashed = axes.collections
    boxes = [path.get_extents().get_points().tolist() for path in asphalt.get_paths()]
    assert boxes == [[[-30, -4], [30, 0]], [[-30, 0], [30, 4]]]
    for path, lane in zip(asphalt.get_paths(), road.lanes, strict=True):
        middle = sum(edge.mean(axis=0) for edge in lane.edges) / 2
        assert path.contains_point(middle)  # not a bow tie
    assert [[line[0, 1] for line in marks.get_segments()] for marks in (solid, dashed)] == [
        [-4, 4],
        [0],
    ]
    assert solid.get_linestyle() != dashed.get_linestyle()
    assert asphalt.get_zorder() < solid.get_zorder() < 1  # below the cars
    bare = Figure().add_subplot()
    road.frame(bare, lanes=False)
    assert not bare.collections
    assert bare.get_ylim() == axes.get_ylim()


@pytest.mark.parametrize(
    ("height", "stretch"), [(20.0, 1.0), (10.0, 1.0), (6.0, 1.5), (5.0, 2.0), (1.0, 3.0)]
)
def test_a_long_road_is_stretched_across(road, scene, height, stretch):
    limits = ((-30.0, 30.0), (-height / 2, height / 2))
    long = replace(road, limits=limits)
    assert long.stretch == stretch
    assert long.stretch_note == ("" if stretch == 1 else f" (py stretched × {stretch:g})")
    axes = Figure().add_subplot()
    long.frame(axes)
    assert axes.get_aspect() == stretch
    assert replace(scene, limits=limits).stretch == 1
    assert long.is_wide == (2 * height < 60)


def test_a_scene_is_cut_around_a_position(road):
    cut = road.around(np.array([25.0, -3.0]), 8.0)
    assert cut.limits == ((17.0, 30.0), (-10.0, 5.0))
    turned = replace(road, axes_order=(1, 0)).around(np.array([-3.0, 25.0]), 8.0)
    assert turned.limits == cut.limits
    inside, beside, above = (np.array([x, y, 0.0, 0.0]) for x, y in ((17, 5), (16.9, 0), (20, 5.1)))
    assert [cut.shows(state) for state in (inside, beside, above)] == [True, False, False]


@pytest.mark.parametrize("heading", [0.0, 0.6, 3.0])
def test_cars_have_their_size_and_others_are_dots(road, scene, heading):
    axes = Figure().add_subplot()
    state = np.array([3.0, -1.0, heading, 9.0])
    road.draw_car(axes, state, "red", label="7")
    road.draw_car(axes, state, "red", filled=False)
    full, empty = axes.patches
    corners = full.get_xy()[:4]
    np.testing.assert_allclose(corners.mean(axis=0), state[:2])
    np.testing.assert_allclose(
        corners[1] - corners[0], 5 * np.array([np.cos(heading), np.sin(heading)])
    )
    assert (full.get_facecolor()[3], full.get_edgecolor()[:3]) == (1.0, (1.0, 0.0, 0.0))
    assert 0 < empty.get_facecolor()[3] < 0.3
    (text,) = axes.texts
    assert (text.get_text(), text.get_position()) == ("7", (3.0, -1.0))
    assert text.get_zorder() > full.get_zorder()
    assert not axes.lines
    dots = Figure().add_subplot()
    scene.draw_car(dots, state, "red", label="7")
    scene.draw_car(dots, state, "red")
    first, second = dots.lines
    np.testing.assert_allclose(first.get_xydata(), [[3.0, -1.0]])
    assert first.get_markersize() > second.get_markersize()
    assert first.get_alpha() > second.get_alpha()
    assert len(dots.texts) == 1 and not dots.patches


def test_asphalt_covers_each_lane_from_edge_to_edge(scene):
    x = np.linspace(0, 50, 6)
    edges = tuple(np.column_stack([x, np.full(6, side)]) for side in (-2.0, 2.0))
    road = replace(scene, lanes=(LaneShape(edges, ("solid", "dashed")),))
    axes = Figure().add_subplot()
    road.draw_asphalt(axes)
    (area,) = axes.collections
    (path,) = area.get_paths()
    right, up = path.vertices.T
    covered = 0.5 * abs(np.dot(right, np.roll(up, 1)) - np.dot(up, np.roll(right, 1)))
    assert covered == pytest.approx(50 * 4)


@pytest.mark.parametrize("places", [[(0, 0)], [(0, 0), (0, 1), (1, 0)], [(0, 1), (1, 0), (2, 0)]])
def test_panels_keep_the_shape_and_size_of_what_they_show(scene, places):
    figure, panels = scene_panels(scene, places, margin=(0.3, 0.9))
    rows, columns = (1 + max(numbers) for numbers in zip(*places, strict=True))
    width, height = figure.get_size_inches() - [0.3, 0.9]
    panel = np.array([width / columns, height / rows]) - [0.25, 0.45]
    assert panel[0] / panel[1] == pytest.approx(scene.extents[0] / scene.extents[1])
    for axes, (row, column) in zip(panels, places, strict=True):
        assert (axes.get_xlim(), axes.get_ylim()) == scene.limits
        first = column == min(c for r, c in places if r == row)
        last = row == max(r for r, c in places if c == column)
        assert bool(axes.get_ylabel()) == first
        assert bool(axes.get_xlabel()) == last
        shown = axes.xaxis.get_tick_params(), axes.yaxis.get_tick_params()
        assert [shown[0]["labelbottom"], shown[1]["labelleft"]] == [last, first]


def test_a_road_takes_more_room_than_two_players(scene, road):
    areas = []
    for one in (scene, replace(scene, recording=road.recording)):
        figure, _ = scene_panels(one, [(0, 0)], margin=(0.0, 0.0), lanes=False)
        areas.append(np.prod(figure.get_size_inches() - [0.25, 0.45]))
    assert 4 < areas[0] < areas[1] < 15
