"""The scripts that train networks write the same file twice, and one that can be read.

They run in another process, as those of ``tests/envs/test_learning_guide.py``.
"""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from olne_bench.bench.judge.cloned_policy import Policy
from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.neural_posterior import game_key
from olne_bench.estimators.shared.mixture_network import MixtureNetwork

pytestmark = pytest.mark.learners

ROOT = Path(__file__).parents[2]
GAME = get_scenario("two_player").game


def run(script: str, *words: object) -> str:
    command = [sys.executable, ROOT / "scripts" / script, *map(str, words)]
    path = os.pathsep.join(one for one in sys.path if one)
    env = os.environ | {"PYTHONPATH": path}
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.fixture(scope="module")
def draws(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("draws") / "draws.npz"
    words = "two_player", "--draws", 40, "--out", path
    assert "40 equilibria of 40 draws" in run("learned_draws.py", *words)
    with np.load(path) as file:
        assert file["weights"].shape == (40, 2, 4)
        assert file["states"].shape == (40, 25, 2, 4)
    return path


@pytest.mark.parametrize("kind", ["posterior", "policy"])
def test_training_can_be_repeated(kind, draws, tmp_path) -> None:
    files = [tmp_path / f"{k}.npz" for k in range(2)]
    for file in files:
        words = "--draws", draws, "--steps", 3, "--out", file
        said = run("train_learned.py", kind, "two_player", *words)
        assert "two_player: 40 truths" in said
    assert files[0].read_bytes() == files[1].read_bytes()
    read = MixtureNetwork.read if kind == "posterior" else Policy.read
    assert read(files[0]).game == game_key(GAME)
