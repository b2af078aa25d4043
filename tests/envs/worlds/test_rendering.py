"""Frames show the scene: never blank, with every player in view and in its colour."""

import itertools

import numpy as np
import pytest

from olne_bench.envs import olne_v0
from olne_bench.envs.scenarios.scenario import Limits, Scenario
from olne_bench.envs.worlds import rendering
from olne_bench.envs.worlds.rendering import (
    HEADER,
    MARGIN,
    MAX_HEIGHT,
    MAX_WIDTH,
    SHARPNESS,
    Camera,
)
from olne_bench.games.model.costs import ControlEffort, FinalGoal, StateDeviation
from olne_bench.games.model.dynamics import DOUBLE_INTEGRATOR
from olne_bench.games.model.game import Game, Player


def frames(world, actions=None):
    _, infos = world.reset(seed=1)
    shown = [world.render()]
    while world.agents:
        played = actions or {p: infos[p]["olne_action"] for p in world.agents}
        *_, infos = world.step(played)
        shown.append(world.render())
    return shown


def shows(frame, player):
    """Number of pixels in exactly a player's colour, without the legend."""
    scene = frame[HEADER:]
    return int((scene == rendering._colour(player)).all(axis=-1).sum())


@pytest.mark.parametrize("name", ["two_player", "highway_overtaking", "random"])
def test_every_frame_shows_every_player(name):
    world = olne_v0.parallel_env(name, render_mode="rgb_array")
    shown = frames(world)
    assert len({frame.shape for frame in shown}) == 1
    for frame in shown:
        assert frame.dtype == np.uint8
        assert frame.std() > 5
        for player in range(world.max_num_agents):
            assert shows(frame, player) > 30
    for before, after in itertools.pairwise(shown):
        assert (before != after).any()


def test_cars_move_to_the_right_along_the_road():
    """The road runs along y; a scene that is taller than wide is turned."""
    world = olne_v0.parallel_env("highway_overtaking", render_mode="rgb_array")
    shown = frames(world)
    height, width, _ = shown[0].shape
    assert width > height
    columns = [
        np.argwhere((frame[HEADER:] == rendering._colour(1)).all(axis=-1))[:, 1].mean()
        for frame in (shown[0], shown[-1])
    ]
    assert columns[1] > columns[0] + 100


def test_view_widens_for_players_who_leave():
    world = olne_v0.parallel_env("two_player", render_mode="rgb_array")
    straight_on = {player: np.array([0.0, 1.0]) for player in world.possible_agents}
    last = frames(world, straight_on)[-1]
    assert np.abs(world.state()[:2]).max() > 10  # far from the unit circle of the goals
    assert shows(last, 0) > 30
    assert shows(last, 1) > 30


def drift(*tasks) -> Scenario:
    """Players with a velocity, each with a task or without a goal."""
    players = tuple(
        Player((StateDeviation("vx"), ControlEffort("ax")), task) for task in tasks or [()]
    )
    return Scenario(
        name="drift",
        game=Game(players, DOUBLE_INTEGRATOR, horizon=3, dt=1.0),
        weights=np.ones((len(players), 2)),
        initial_state=np.tile([0.0, 0.0, 0.0, 1.0], (len(players), 1)),
        limits=Limits(controls=(1.0, 1.0), states=(10.0, 10.0, 10.0, 10.0)),
    )


@pytest.mark.parametrize(
    ("velocity", "extent"),
    [((1, 0), (1, 0.48)), ((0, -2), (0.48, 1)), ((1, 1), (1.48 / 2**0.5, 1.48 / 2**0.5))],
)
def test_a_car_is_a_box_along_its_heading_about_its_position(velocity, extent):
    expected = np.array([[[-10.0, -10, 0, 0]], [[10, 10, 0, 0]]])
    renderer = rendering.Renderer(drift(), expected, None)
    shown = Camera(expected[:, 0, :2])
    scene = renderer.draw([np.array([[4, 3, *velocity]])], 0.0)[HEADER:]
    rows, columns = np.nonzero(scene.min(axis=-1) < 100)  # the ground is bright
    corners = np.array([[columns.min(), rows.min()], [columns.max(), rows.max()]])
    length = rendering.CAR_LENGTH * min(MAX_HEIGHT, MAX_WIDTH)  # of a square view
    np.testing.assert_allclose(np.ptp(corners, axis=0), length * np.array(extent), atol=2.5)
    place = np.array(shown.pixels([4, 3])) / SHARPNESS - [0, HEADER]
    np.testing.assert_allclose(corners.mean(axis=0), place, atol=1.5)


def test_trails_fade_and_lead_to_the_car():
    expected = np.array([[[-10.0, -10, 0, 0]], [[10, 10, 0, 0]]])
    renderer = rendering.Renderer(drift(), expected, None)
    history = [np.array([[x, 0.0, 1, 0]]) for x in np.arange(-8.0, 9.0)]
    frame = renderer.draw(history, 0.0)
    shown = Camera(expected[:, 0, :2])
    middles = [shown.pixels([x, 0.0]) for x in np.arange(-7.5, 7.0)]
    columns, rows = (np.array(middles) // SHARPNESS).astype(int).T
    red = frame[rows, columns, 0].astype(int)  # the car's blue has none, the ground most
    assert (np.diff(red) <= 0).all()
    assert red[-1] < red[0] - 60
    assert red[0] < rendering.BACKGROUND[0] - 30  # the oldest part is still visible


def test_without_a_render_mode_render_says_so():
    world = olne_v0.parallel_env("two_player")
    world.reset()
    with pytest.warns(UserWarning, match="render_mode"):
        assert world.render() is None


SQUARE = np.array([[[-10.0, -10, 0, 0]], [[10, 10, 0, 0]]])
FAR = [0.0, 10.0, 1.0, 0.0]  # a car that is out of the way, near the upper edge


def drawn(renderer, *states, time=0.0):
    """A frame of players at these states."""
    return renderer.draw([np.array(states)], time).astype(int)


def is_like(frame, colour, by=12):
    """Which pixels (height, width) have a colour, nearly."""
    return np.abs(frame - colour).max(axis=-1) <= by


def in_world(renderer, pixels):
    """Where pixels (P, 2), of rows and columns, lie in a view that is not turned [m]."""
    origin = np.array(renderer._view.pixels([0.0, 0.0]))
    return ((pixels[:, ::-1] + 0.5) * SHARPNESS - origin) * [1, -1] / renderer._view.scale


def test_a_goal_is_a_ring_around_a_dot_in_its_players_colour():
    goal = (4.0, -3.0)
    renderer = rendering.Renderer(drift((), (FinalGoal(goal),)), SQUARE, None)
    frame = drawn(renderer, FAR, FAR)
    points = np.argwhere(is_like(frame, rendering._colour(1)))
    offsets = in_world(renderer, points) - goal
    of_goal = np.abs(offsets).max(axis=1) < 3
    distance = np.hypot(*offsets[of_goal].T) * renderer._view.scale / SHARPNESS  # [px]
    np.testing.assert_allclose(offsets[of_goal].mean(axis=0), 0, atol=0.05)
    dot, ring = distance[distance < 5], distance[distance >= 5]
    assert len(dot) > 12 and dot.max() < 4
    assert len(ring) > 60
    assert ring.min() > 6 and 8 <= ring.max() <= 10  # there is ground between the two


def test_a_goal_out_of_the_way_is_in_view():
    renderer = rendering.Renderer(drift((FinalGoal((60.0, -50.0)),)), SQUARE, None)
    assert (renderer._view.low < [-10, -50]).all() and (renderer._view.high > [60, 10]).all()


@pytest.mark.parametrize("targets", [(-3.0, 0.0, 3.0), (-4.0, 4.0), (1.0,)])
def test_a_road_has_lanes_about_what_players_keep_to(targets):
    tasks = [(StateDeviation("px", target=target),) for target in targets]
    renderer = rendering.Renderer(drift(*tasks), SQUARE, None)
    frame = drawn(renderer, *[FAR] * len(targets))
    size = renderer._car_length
    width = targets[1] - targets[0] if len(targets) > 1 else 2 * size
    rows = slice(HEADER + 120, None)  # below the cars
    bare = is_like(frame[rows], rendering.BACKGROUND, by=2)
    # Nothing but ground beside the road, none of it on the road, from one end to the other.
    assert (bare.all(axis=0) | ~bare.any(axis=0)).all()
    across = np.flatnonzero(~bare.any(axis=0))
    edges = in_world(renderer, np.array([[0, across[0]], [0, across[-1]]]))[:, 0]
    expected = [targets[0] - width / 2, targets[-1] + width / 2]
    np.testing.assert_allclose(edges, expected, atol=0.06)
    # Dashes between lanes, as long as a car, with as long a gap.
    marks = is_like(frame[rows], rendering.LANE_MARK, by=3) & ~bare
    columns = np.flatnonzero(marks.any(axis=0))
    if len(targets) == 1:
        assert len(columns) == 0
        return
    places = in_world(renderer, np.column_stack([0 * columns, columns]))[:, 0]
    between = np.array(targets[:-1]) + width / 2
    assert np.abs(places[:, None] - between).min(axis=1).max() < 0.1
    assert np.abs(places[:, None] - between).min(axis=0).max() < 0.1
    line = marks[:, columns[len(columns) // 2]]
    changes = np.flatnonzero(np.diff(line.astype(int)))
    lengths = np.diff(changes) * SHARPNESS / renderer._view.scale
    np.testing.assert_allclose(lengths, size, atol=0.12)
    assert len(lengths) > 5


def test_a_road_goes_on_where_the_view_widens():
    renderer = rendering.Renderer(drift((StateDeviation("px"),)), SQUARE, None)
    for place in ([0.0, 80.0, 0, 1], [0.0, -200.0, 0, 1]):
        frame = drawn(renderer, place)
        middle = round(renderer._view.pixels([0.0, 0.0])[0] / SHARPNESS)
        if renderer._view._turned:
            raise AssertionError("the first view is square")
        line = frame[HEADER + 1 :, middle]
        assert not is_like(line, rendering.BACKGROUND, by=2).any()


def test_cars_stay_visible_in_a_wide_view():
    renderer = rendering.Renderer(drift(), SQUARE, None)
    before = renderer._car_length
    frame = drawn(renderer, [4000.0, 0.0, 1.0, 0.0])
    assert renderer._car_length > 3 * before
    _, columns = np.nonzero(frame[HEADER:].min(axis=-1) < 100)
    assert np.ptp(columns) + 1 == pytest.approx(rendering.MIN_CAR_LENGTH, abs=2)


def test_a_car_has_its_windscreen_ahead_and_a_dark_outline():
    renderer = rendering.Renderer(drift(), SQUARE, None)
    colour = np.array(rendering._colour(0))
    frame = drawn(renderer, [0.0, 0.0, 1.0, 0.0])
    length = renderer._car_length

    def places(colour):
        return in_world(renderer, np.argwhere(is_like(frame, colour, by=3))) / length

    glass = places(rendering._mix(tuple(colour), (255, 255, 255), 0.35))
    glass = glass[np.abs(glass).max(axis=1) < 1]
    np.testing.assert_allclose([glass[:, 0].min(), glass[:, 0].max()], [0.1, 0.3], atol=0.06)
    width = rendering.CAR_ASPECT
    assert np.ptp(glass[:, 1]) == pytest.approx(0.8 * width, abs=0.08)
    np.testing.assert_allclose(glass[:, 1].mean(), 0, atol=0.02)
    # The outline is darker than the car, thin, and on the edge.
    dark = places(rendering._mix(tuple(colour), (0, 0, 0), 0.6))
    dark = dark[np.abs(dark).max(axis=1) < 1]
    assert 15 < len(dark) < 100
    beside = np.abs(np.abs(dark) - [0.5, width / 2]).min(axis=1)
    assert beside.max() < 0.1


def test_a_trail_is_a_line_of_dots_narrower_than_a_car():
    renderer = rendering.Renderer(drift(), SQUARE, None)
    history = [np.array([[x, 0.0, 1, 0]]) for x in (-8.0, -4.0, 8.0)]
    frame = renderer.draw(history, 0.0).astype(int)
    scene = ~is_like(frame, rendering.BACKGROUND, by=6)
    scene[:HEADER] = False

    def thickness(x):
        """Height of what is drawn at x, between the joints or at one."""
        column = renderer._view.pixels([x, 0.0])[0] / SHARPNESS
        return scene[:, round(column)].sum()

    line, joint = thickness(0.0), thickness(-4.0)
    assert 2 <= line <= 4
    assert line < joint <= 7
    assert joint < thickness(8.0)
    assert thickness(-9.0) == 0
    _, columns = np.nonzero(scene)
    first = renderer._view.pixels([-8.0, 0.0])[0] / SHARPNESS
    assert columns.min() == pytest.approx(first - joint / 2, abs=1.5)


def test_the_header_has_the_time_above_the_players_in_order():
    renderer = rendering.Renderer(drift(*[()] * 3), SQUARE, None)
    frame, later = (drawn(renderer, FAR, FAR, FAR, time=t) for t in (0.0, 12.34))
    header, next_header = frame[:HEADER], later[:HEADER]
    title = np.argwhere(is_like(header, rendering.INK, by=25))
    changed = np.argwhere((header != next_header).any(axis=-1))
    assert changed[:, 0].max() <= title[:, 0].max() + 2  # the time is part of the title
    assert np.ptp(title[:, 1]) > 60
    legend = [np.argwhere(is_like(header, rendering._colour(k), by=25)) for k in range(3)]
    for words in legend:
        assert words[:, 0].min() > title[:, 0].max()
        assert words[:, 0].max() < HEADER - 2
        assert 10 < np.ptp(words[:, 0]) < 25  # readable, and on a line
    assert title[:, 0].min() > 2
    # Title and legend begin below each other, off the edge.
    assert abs(legend[0][:, 1].min() - title[:, 1].min()) <= 4
    assert 8 <= title[:, 1].min() <= 30
    for left, right in itertools.pairwise(legend):
        gap = right[:, 1].min() - left[:, 1].max()
        assert 8 <= gap <= 40
    # The scene does not reach into the header.
    ground = is_like(header, rendering.BACKGROUND, by=0)
    assert ground[:2].all() and ground[-2:].all()


def test_colours_are_mixed_by_their_shares():
    assert rendering._mix((100, 0, 10), (0, 200, 20), 0.25) == (25, 150, 18)
    assert rendering._mix((1, 2, 3), (4, 5, 6), 1.0) == (1, 2, 3)
    assert rendering._colour(0) == (0x7A, 0x3F, 0xD1)
    assert all(np.ptp(rendering._colour(k)) > 50 for k in range(8))


WIDE = np.array([[0.0, 0.0], [40.0, 10.0]])


def test_a_view_has_a_margin_around_what_is_expected() -> None:
    view = Camera(WIDE)
    np.testing.assert_allclose(view.low[0], -view.high[0] + 40)
    margin = MARGIN * 40 * (1 + 2 * MARGIN)
    np.testing.assert_allclose([view.low[0], view.low[1]], [-margin, -margin])
    np.testing.assert_allclose(view.high, [40 + margin, 10 + margin])


def test_a_line_is_seen_in_a_box_no_longer_than_four_to_one() -> None:
    view = Camera(np.array([[0.0, 5.0], [40.0, 5.0]]))
    width, height = view.high - view.low
    assert height == pytest.approx(
        width * (1 + 2 * MARGIN) / (1 + 2 * MARGIN * (1 + 2 * MARGIN)) / 4
    )
    np.testing.assert_allclose((view.low + view.high) / 2, [20, 5])


def test_a_single_point_has_a_view() -> None:
    view = Camera(np.array([[3.0, 3.0]]))
    assert (view.high > view.low).all()
    np.testing.assert_allclose((view.high - view.low)[0], 1e-3 * 0.24 * (1 + 2 * MARGIN), rtol=0.05)


@pytest.mark.parametrize("tall", [False, True])
def test_frames_are_as_large_as_they_may_be(tall: bool) -> None:
    view = Camera(WIDE[:, ::-1] if tall else WIDE)
    width, height = view.frame_size
    assert width == MAX_WIDTH or height - HEADER == MAX_HEIGHT
    assert width <= MAX_WIDTH
    assert height - HEADER <= MAX_HEIGHT
    assert width > height


def test_corners_come_to_the_edges_and_the_middle_below_the_header() -> None:
    view = Camera(WIDE)
    width, height = (SHARPNESS * n for n in view.frame_size)
    middle = view.pixels((view.low + view.high) / 2)
    np.testing.assert_allclose(middle, [width / 2, (SHARPNESS * HEADER + height) / 2])
    upper_left = view.pixels([view.low[0], view.high[1]])
    np.testing.assert_allclose(upper_left, [0, SHARPNESS * HEADER], atol=SHARPNESS)
    lower_right = view.pixels([view.high[0], view.low[1]])
    np.testing.assert_allclose(lower_right, [width, height], atol=SHARPNESS)


def test_a_tall_view_is_turned_so_that_y_points_right_and_x_down() -> None:
    view = Camera(WIDE[:, ::-1])
    origin = np.array(view.pixels((view.low + view.high) / 2))
    along_y = np.array(view.pixels((view.low + view.high) / 2 + [0, 1])) - origin
    along_x = np.array(view.pixels((view.low + view.high) / 2 + [1, 0])) - origin
    np.testing.assert_allclose(along_y, [view.scale, 0], atol=1e-9)
    np.testing.assert_allclose(along_x, [0, view.scale], atol=1e-9)


def test_a_view_is_widened_where_it_must_be_and_frames_stay_as_large() -> None:
    view = Camera(WIDE)
    low, high, size, scale = view.low, view.high, view.frame_size, view.scale
    view.widen(np.array([[20.0, 5.0], high, low]))
    assert view.low is low
    assert view.high is high
    view.widen(np.array([[high[0] + 30, 5.0], [20.0, 5.0]]))
    assert view.frame_size == size
    assert view.scale < scale
    assert view.high[0] > high[0] + 30
    assert (view.low < low).all()
    # Widened only slightly: the margin was there before.
    assert view.high[0] < high[0] + 30 + 0.05 * (view.high - view.low)[0]
