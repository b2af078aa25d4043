"""Frames show the scene: never blank, with every player in view and in its colour."""

import itertools

import numpy as np
import pygame
import pytest

from olne_bench.envs import olne_v0, rendering, view
from olne_bench.envs.scenarios.scenario import Limits, Scenario
from olne_bench.envs.scene import heading_of
from olne_bench.games.dynamics import DOUBLE_INTEGRATOR
from olne_bench.games.features import ControlEffort, StateDeviation
from olne_bench.games.game import Game, Player


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
    scene = frame[view.HEADER :]
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
        np.argwhere((frame[view.HEADER :] == rendering._colour(1)).all(axis=-1))[:, 1].mean()
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


def drift() -> Scenario:
    """One player with a velocity and without a goal."""
    player = Player((StateDeviation("vx"), ControlEffort("ax")))
    return Scenario(
        name="drift",
        game=Game((player,), DOUBLE_INTEGRATOR, horizon=3, dt=1.0),
        weights=np.ones((1, 2)),
        initial_state=np.array([[0.0, 0.0, 0.0, 1.0]]),
        limits=Limits(controls=(1.0, 1.0), states=(10.0, 10.0, 10.0, 10.0)),
    )


@pytest.mark.parametrize(
    ("velocity", "extent"),
    [((1, 0), (1, 0.48)), ((0, -2), (0.48, 1)), ((1, 1), (1.48 / 2**0.5, 1.48 / 2**0.5))],
)
def test_a_car_is_a_box_along_its_heading_about_its_position(velocity, extent):
    expected = np.array([[[-10.0, -10, 0, 0]], [[10, 10, 0, 0]]])
    renderer = rendering.Renderer(drift(), expected, None)
    shown = view.View(expected[:, 0, :2])
    scene = renderer.draw([np.array([[4, 3, *velocity]])], 0.0)[view.HEADER :]
    rows, columns = np.nonzero(scene.min(axis=-1) < 100)  # the ground is bright
    corners = np.array([[columns.min(), rows.min()], [columns.max(), rows.max()]])
    length = rendering.CAR_LENGTH * min(view.MAX_HEIGHT, view.MAX_WIDTH)  # of a square view
    np.testing.assert_allclose(np.ptp(corners, axis=0), length * np.array(extent), atol=2.5)
    place = np.array(shown.pixels([4, 3])) / view.SHARPNESS - [0, view.HEADER]
    np.testing.assert_allclose(corners.mean(axis=0), place, atol=1.5)


def test_trails_fade_and_lead_to_the_car():
    expected = np.array([[[-10.0, -10, 0, 0]], [[10, 10, 0, 0]]])
    renderer = rendering.Renderer(drift(), expected, None)
    history = [np.array([[x, 0.0, 1, 0]]) for x in np.arange(-8.0, 9.0)]
    frame = renderer.draw(history, 0.0)
    shown = view.View(expected[:, 0, :2])
    middles = [shown.pixels([x, 0.0]) for x in np.arange(-7.5, 7.0)]
    columns, rows = (np.array(middles) // view.SHARPNESS).astype(int).T
    red = frame[rows, columns, 0].astype(int)  # the car's blue has none, the ground most
    assert (np.diff(red) <= 0).all()
    assert red[-1] < red[0] - 60
    assert red[0] < rendering.BACKGROUND[0] - 30  # the oldest part is still visible


def test_models_without_a_heading_point_along_their_velocity():
    world = olne_v0.parallel_env(drift(), render_mode="rgb_array", reveal_truth=False)
    world.reset()
    world.step({"player_0": np.zeros(2)})
    assert shows(world.render(), 0) > 30
    assert heading_of(np.array([0, 0, 0, 1.0]), DOUBLE_INTEGRATOR.state_names) == np.pi / 2


def test_window_shows_the_frame(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setitem(olne_v0.OlneWorld.metadata, "render_fps", 1000)
    world = olne_v0.parallel_env("two_player", render_mode="human", max_cycles=2)
    world.reset()
    idle = {player: np.zeros(2) for player in world.agents}
    world.step(idle)
    window = pygame.surfarray.array3d(pygame.display.get_surface())
    assert window.std() > 5
    assert world.render() is None
    world.reset()  # the same window is used again
    assert pygame.display.get_surface() is not None
    world.close()
    assert pygame.display.get_surface() is None
    world.close()


def test_without_a_render_mode_render_says_so():
    world = olne_v0.parallel_env("two_player")
    world.reset()
    with pytest.warns(UserWarning, match="render_mode"):
        assert world.render() is None
