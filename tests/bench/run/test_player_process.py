"""Processes of players that follow motions: what one of them breaks is its own motion."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from olne_bench.bench.judge.players import PlayerFault, PlayerTask
from olne_bench.bench.process.messages import unpack
from olne_bench.bench.run.player_process import PlayerProcess
from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.protocol import Problem
from olne_bench.games.model.observation import VIEWS

PLUGIN = """
import os, threading, time
from types import SimpleNamespace
import numpy as np

class Counts:
    name = "Counts"
    def estimate(self, problem, observation, *, rng, budget):
        raise RuntimeError("online, it is not asked")
    def start(self, problem, *, rng, lag=None):
        self.count = 0
        return self
    def update(self, sample, *, budget):
        self.count += 1
        self.act(sample)
        return SimpleNamespace(weights=np.full((2, 4), float(self.count)))
    def act(self, sample):
        pass

class Hangs(Counts):
    name = "Hangs"
    def act(self, sample):
        if self.count == 2:
            time.sleep(4321.25)

class Dies(Counts):
    name = "Dies"
    def act(self, sample):
        if self.count == 2:
            os._exit(3)

class Raises(Counts):
    name = "Raises"
    def act(self, sample):
        if self.count == 2:
            raise RuntimeError("enough")

class Writes(Counts):
    name = "Writes"
    def act(self, sample):
        sample[:] = 0

class LeavesAThread(Counts):
    name = "LeavesAThread"
    def act(self, sample):
        threading.Thread(target=time.sleep, args=(4321.25,), daemon=True).start()

class SaysItsBudget(Counts):
    name = "SaysItsBudget"
    def update(self, sample, *, budget):
        return SimpleNamespace(weights=np.full((2, 4), budget))

class Declines(Counts):
    name = "Declines"
    def supports(self, problem):
        return "not today"
"""
SAMPLE = np.zeros((2, 4))


@pytest.fixture(scope="module")
def plugin(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("plugin") / "counts.py"
    path.write_text(PLUGIN)
    return path


@pytest.fixture
def player() -> Iterator[PlayerProcess]:
    process = PlayerProcess(memory=None, hidden=None)
    yield process
    process.stop()


def a_task(plugin: Path, name: str) -> PlayerTask:
    problem = Problem(get_scenario("two_player").game, VIEWS["full"], 0.01)
    label = f"{plugin}:{name}"
    return PlayerTask(label, {}, label, problem, seed=0, time_limit=1.5)


@pytest.mark.parametrize(
    ("name", "status", "phrase", "good"),
    [
        ("Hangs", "timeout", "killed after 1.5 s of update", 1),
        ("Dies", "crash", "exit code 3", 1),
        ("Raises", "crash", "enough", 1),
        ("Writes", "crash", "read-only", 0),
        ("LeavesAThread", "invalid", "left threads", 1),
    ],
)
def test_misbehaviour_costs_one_motion(plugin, player, name, status, phrase, good) -> None:
    assert player.start(a_task(plugin, name)) is None
    for count in range(1, good + 1):
        answer = player.update(SAMPLE)
        assert unpack(answer.estimate.weights)[0, 0] == count
        assert answer.seconds > 0
    with pytest.raises(PlayerFault, match=phrase) as fault:
        player.update(SAMPLE)
    assert fault.value.status == status
    if name in ("Hangs", "Raises"):  # the next motion begins as if nothing had been
        assert player.start(a_task(plugin, name)) is None
        assert unpack(player.update(SAMPLE).estimate.weights)[0, 0] == 1


def test_the_budget_is_a_share_of_the_limit_or_given(plugin, player) -> None:
    task = a_task(plugin, "SaysItsBudget")
    for given, told in ((None, 0.8 * 1.5), (0.25, 0.25)):
        assert player.start(replace(task, budget=given)) is None
        assert unpack(player.update(SAMPLE).estimate.weights)[0, 0] == pytest.approx(told)


def test_an_estimator_may_decline(plugin, player) -> None:
    assert player.start(a_task(plugin, "Declines")) == "not today"


def test_an_update_needs_a_motion(plugin, player) -> None:
    with pytest.raises(PlayerFault):
        player.update(SAMPLE)
    assert player.start(a_task(plugin, "Counts")) is None
    player.update(SAMPLE)
