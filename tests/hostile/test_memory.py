"""A plugin neither leaves its sandbox nor remembers a trial, in trials and in streams."""

import json
import os
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from olne_bench.bench.judge.players import PlayerTask
from olne_bench.bench.process.sandbox import landlock_version
from olne_bench.bench.run.player_process import PlayerProcess
from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.solved import KEPT_DRAWS, shipped_draws
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.games.model.observation import FullView

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or landlock_version() < 6, reason="needs Landlock, Linux 6.12 or later"
)

GAME = get_scenario("two_player").game
SHAPE = (GAME.horizon, GAME.num_players, 4)


@pytest.fixture
def plugin(tmp_path) -> Path:
    file = tmp_path / "plugin.py"
    shutil.copy(Path(__file__).with_name("memory.py"), file)
    run, copy = tmp_path / "run", tmp_path / "copy"
    for folder in (run, copy, KEPT_DRAWS.folder):
        folder.mkdir(exist_ok=True)
    (run / "trials.sqlite").write_text("salt")
    secrets = [str(run / "trials.sqlite"), "/etc/shadow"]
    for draws in shipped_draws().glob("*.draws"):
        secrets += [str(draws), shutil.copy(draws, copy)]
    secrets += [f"/proc/{os.getpid()}/{name}" for name in ("mem", "environ", "maps", "cmdline")]
    file.with_suffix(".json").write_text(json.dumps(secrets))
    return file


def in_trials(plugin: Path, name: str) -> list:
    """What it says in two trials of one game, with no noise and with much."""
    player = PlayerProcess(memory=2**30, hidden=plugin.parent / "run")
    try:
        said = []
        for sigma in (0.0, 1.0):
            problem = Problem(GAME, FullView(), sigma)
            seen = (Observation(np.zeros(SHAPE)),)
            task = PlayerTask(f"{plugin}:{name}", {}, name, problem, 0, 20.0, observations=seen)
            answer = player.estimate(task)
            assert answer.estimate is not None
            said.append(json.loads(answer.estimate.message))
        return said
    finally:
        player.stop()


def in_streams(plugin: Path, name: str) -> list:
    """What it says at the end of two motions."""
    player = PlayerProcess(memory=2**30, hidden=plugin.parent / "run")
    try:
        said = []
        for sigma in (0.0, 1.0):
            problem = Problem(GAME, FullView(), sigma)
            task = PlayerTask(f"{plugin}:{name}", {}, name, problem, 0, 20.0)
            assert player.start(task) is None
            answer = player.update(np.zeros(SHAPE[1:]))
            assert answer.estimate is not None
            said.append(json.loads(answer.estimate.message))
        return said
    finally:
        player.stop()


@pytest.mark.parametrize("play", [in_trials, in_streams])
def test_nothing_is_remembered(plugin, play):
    assert play(plugin, "Remembers") == [[], []]


@pytest.mark.parametrize("play", [in_trials, in_streams])
def test_no_thread_leaves_the_sandbox(plugin, play):
    for said in play(plugin, "Leaves"):
        assert said == {"read": [], "privileges": ["12"]}
