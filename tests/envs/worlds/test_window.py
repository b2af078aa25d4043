"""Worlds in a window: PettingZoo's tests in both render modes, one window, signals unchanged."""

import copy
import os
import signal
import subprocess
import sys
from functools import partial

import numpy as np
import pygame
import pytest
from pettingzoo.test import parallel_api_test, render_test

from olne_bench.envs import highway_v0, olne_v0
from olne_bench.envs.roads.highway_roads import ROAD_NAMES, make_road
from olne_bench.envs.scenarios import scenario_names
from olne_bench.envs.worlds.window import Window
from tests.envs.conftest import drawn

NAMES = tuple(scenario_names())


@pytest.fixture(autouse=True)
def no_screen(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setitem(olne_v0.OlneWorld.metadata, "render_fps", 1000)


def arguments(name):
    """Module and scenario; episodes are short, as each of their frames takes its time."""
    if name in ROAD_NAMES:
        return highway_v0, {"scenario": drawn(name), "max_cycles": 2}
    return olne_v0, {"scenario": name, "max_cycles": 2}


def shown():
    """The frame (width, height, 3) in the window."""
    return pygame.surfarray.array3d(pygame.display.get_surface())


@pytest.mark.parametrize("name", NAMES)
def test_upstream_render_test(name):
    module, chosen = arguments(name)
    render_test(partial(module.env, **chosen))


@pytest.mark.parametrize("mode", ["human", "rgb_array"])
@pytest.mark.parametrize("name", NAMES)
def test_upstream_parallel_api_test(name, mode):
    module, chosen = arguments(name)
    world = module.parallel_env(render_mode=mode, **chosen)
    parallel_api_test(world, num_cycles=4)
    world.close()


@pytest.mark.parametrize("name", ["two_player", *ROAD_NAMES])
def test_the_window_shows_what_the_array_holds(name):
    module, chosen = arguments(name)
    world = module.parallel_env(render_mode="human", **chosen)
    pictures = module.parallel_env(render_mode="rgb_array", **chosen)
    for each in (world, pictures):
        each.reset(seed=0)
    assert shown().std() > 5  # SDL's dummy driver draws black frames for HighwayEnv
    for _ in range(2):
        before = shown()
        for each in (world, pictures):
            each.step({player: np.array([0.01, 0.5]) for player in each.agents})
        assert np.array_equal(shown().swapaxes(0, 1), pictures.render())
        assert world.render() is None
        assert not np.array_equal(shown(), before)
    world.close()
    assert pygame.display.get_surface() is None


def test_frames_between_two_actions_are_shown(monkeypatch):
    frames = []
    monkeypatch.setattr(Window, "show", lambda _, frame: frames.append(frame) or [])
    road = make_road("merge", "human")
    road.place(drawn("merge").initial_state)
    road.render()
    road.apply(np.zeros((2, 2)))
    assert len(frames) == 1 + 5  # of the six sub-steps, the last is drawn when it is asked for
    assert not np.array_equal(frames[0], frames[-1])


@pytest.mark.parametrize("name", ["two_player", "merge"])
def test_a_world_closes_its_own_window_only(name):
    module, chosen = arguments(name)
    world = module.parallel_env(render_mode="human", **chosen)
    world.reset(seed=0)
    twin = copy.deepcopy(world)
    twin.close()
    assert pygame.display.get_surface() is not None  # the twin has not drawn
    twin.render()
    world.close()
    assert pygame.display.get_surface() is not None  # it is the twin's window now
    twin.close()
    assert pygame.display.get_surface() is None
    world.render()  # opens it again
    assert shown().std() > 5
    world.close()


DRAW = """
import signal, sys, time
{handler}
interrupted = signal.getsignal(signal.SIGINT)
from olne_bench.envs import {module}
world = {module}.parallel_env({name!r}, render_mode={mode!r}, **{options})
world.reset(seed=0)
world.render()
print(signal.getsignal(signal.SIGTERM) is {expected}, signal.getsignal(signal.SIGINT) is \
interrupted, flush=True)
time.sleep(60)
"""

MERGE = {"module": "highway_v0", "name": "merge", "options": {"num_players": 2}}
TWO_PLAYER = {"module": "olne_v0", "name": "two_player", "options": {}}


@pytest.mark.parametrize(
    ("world", "mode"), [(MERGE, "human"), (MERGE, "rgb_array"), (TWO_PLAYER, "human")]
)
def test_sigterm_ends_a_process_that_has_drawn(world, mode):
    code = end(**world, mode=mode, handler="", expected="signal.SIG_DFL")
    assert code in (-signal.SIGTERM, 1)  # 1 on Windows


def test_the_users_own_handler_stays():
    handler = "def leave(*_):\n    sys.exit(7)\nsignal.signal(signal.SIGTERM, leave)"
    assert end(**MERGE, mode="human", handler=handler, expected="leave") == 7


def end(**values):
    """The exit code of a process that draws and is then terminated."""
    # The child must make the same settings as this process did when it imported the worlds.
    environment = {k: v for k, v in os.environ.items() if k != "SDL_NO_SIGNAL_HANDLERS"}
    command = [sys.executable, "-c", DRAW.format(**values)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    try:
        assert process.stdout.readline().split() == ["True", "True"]
        process.terminate()
        return process.wait(timeout=20)
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
