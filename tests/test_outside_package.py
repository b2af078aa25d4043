"""A scenario, a sensor and a metric of another package, run in a suite and reported."""

import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

LONGEST = 25

SCENARIO = """
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from olne_bench.envs.scenarios.scenario import Limits, Scenario
from olne_bench.games.model.dynamics import UNICYCLE
from olne_bench.games.model.costs import ControlEffort, FinalGoal, Proximity, StateDeviation
from olne_bench.games.model.game import Game, Player


@dataclass(frozen=True)
class Passing:
    name: ClassVar[str] = "passing"
    gap: float = 0.3

    def draw(self, seed: int) -> Scenario:
        rng = np.random.default_rng(seed)
        own = (StateDeviation("speed", target=0.3), ControlEffort("acceleration", scale=10.0))
        wants = (Proximity(), *own, ControlEffort("yaw_rate"))
        players = tuple(Player(wants, (FinalGoal((x, 0.0)),)) for x in (1.0, -1.0))
        starts = np.array([[-1, self.gap / 2, 0, 0.3], [1, -self.gap / 2, np.pi, 0.3]])
        game = Game(players, UNICYCLE, horizon=15, dt=0.4)
        limits = Limits(controls=(3.0, 3.0), states=(20.0, 20.0, 20.0, 9.0))
        return Scenario("passing", game, rng.uniform(0.5, 1, (2, 4)), starts, limits)
"""

SENSOR = """
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from olne_bench.games.model.observation import View


@dataclass(frozen=True)
class Squint(View):
    name: str = "squint"
    angle: float = 0.1

    def expected(self, state, dynamics):
        cos, sin = float(ca.cos(self.angle)), float(ca.sin(self.angle))
        turned = cos * state[0] - sin * state[1], sin * state[0] + cos * state[1]
        return ca.vertcat(*turned, state[2])

    def component_names(self, dynamics):
        return ("ahead", "left", "heading")


@dataclass(frozen=True)
class Camera:
    name: ClassVar[str] = "camera"
    angle: float = 0.1

    def layers(self):
        return (Squint(angle=self.angle),)
"""

METRIC = '''
from dataclasses import dataclass
from typing import ClassVar

import numpy as np


@dataclass(frozen=True)
class LargestError:
    """Largest difference between an estimated weight and the true one."""

    name: ClassVar[str] = "largest_error"
    label: ClassVar[str] = "largest weight error"
    unit: ClassVar[str] = "share"
    worst: ClassVar[float] = 1.0
    gated: ClassVar[bool] = True
    compared: ClassVar[bool] = True

    def score(self, case) -> float:
        return float(np.abs(case.estimate.weights - case.weights).max())
'''

SUITE = """
name = "outside"
scenarios = [{ name = "passing", options = { gap = 0.4 } }]
sensors = ["full", { name = "camera", parameters = { angle = 0.2 } }]
metrics = ["largest_error"]
sigmas = [0.01]
seeds = 1
estimators = ["kkt_constrained", "uniform"]

[gate.kkt_constrained]
largest_error = 1.0
"""

ENTRY_POINTS = """
[olne_bench.scenarios]
passing = somebodys_traffic.scenario:Passing

[olne_bench.sensors]
camera = somebodys_traffic.sensor:Camera

[olne_bench.metrics]
largest_error = somebodys_traffic.metric:LargestError
"""


@pytest.fixture(scope="module")
def outside(tmp_path_factory):
    """A folder with the package, as installed, beside folders that a user may have."""
    folder = tmp_path_factory.mktemp("outside")
    package = folder / "installed" / "somebodys_traffic"
    package.mkdir(parents=True)
    texts = {"__init__": "", "scenario": SCENARIO, "sensor": SENSOR, "metric": METRIC}
    for name, text in texts.items():
        (package / f"{name}.py").write_text(text)
    about = folder / "installed" / "somebodys_traffic-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: somebodys-traffic\nVersion: 1.0\n"
    )
    (about / "entry_points.txt").write_text(ENTRY_POINTS)
    for own in ("bench", "envs", "games", "estimators"):
        (folder / own).mkdir()
        (folder / own / "__init__.py").write_text("raise ImportError('this is mine')\n")
    (folder / "outside.toml").write_text(SUITE)
    return folder


def call(folder: Path, *words: str) -> str:
    path = f"{folder / 'installed'}:{Path(__file__).parents[1] / 'src'}"
    command = [sys.executable, "-m", "olne_bench", *words]
    environment = {"PYTHONPATH": path, "PATH": "/usr/bin:/bin", "HOME": str(Path.home())}
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def run(outside):
    """The folder of a run, and its output."""
    said = call(outside, "run", "outside.toml", "--out", "run", "--jobs", "1", "--formats", "svg")
    return outside / "run", said


@pytest.mark.parametrize("text", [SCENARIO, SENSOR, METRIC])
def test_plugins_are_short(text):
    code = [line for line in text.splitlines() if line.strip()]
    assert len(code) <= LONGEST


def test_they_are_listed(outside):
    listed = call(outside, "list")
    for name in ("passing", "camera", "largest_error"):
        assert name in listed


def test_rows_have_them(run):
    rows = pd.read_parquet(run[0] / "trials.parquet")
    assert set(rows["scenario"]) == {"passing(gap=0.4)"}
    assert set(rows["sensor"]) == {"full", "camera(angle=0.2)"}
    assert (rows["status"] == "ok").all(), rows[["status", "message"]]
    assert rows["largest_error"].between(0, 1).all()
    assert rows.loc[rows["estimator"] == "kkt_constrained", "largest_error"].median() < 0.5


def test_tables_page_and_figures_show_them(run):
    folder, said = run
    assert "Position error [m]" in said
    for name in ("leaderboard.md", "index.html"):
        text = (folder / name).read_text().lower()
        assert "largest weight error" in text, name
        assert "camera" in text, name
    assert "largest_error_median" in (folder / "leaderboard.csv").read_text()
    figures = {path.name: path.read_text() for path in (folder / "figures").glob("*.svg")}
    errors = next(text for name, text in figures.items() if name.startswith("errors_passing"))
    assert len(errors) > 10_000


@pytest.mark.usefixtures("run")
def test_the_gate_and_the_comparison_know_the_metric(outside):
    assert "largest_error" in call(outside, "gate", "run")
    assert "largest" in call(outside, "compare", "run", "run")


def test_users_folders_of_our_names_are_left_alone(outside):
    path = f"{outside}:{Path(__file__).parents[1] / 'src'}"
    code = "from olne_bench.envs import highway_v0; print(highway_v0.parallel_env('highway'))"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=outside,
        env={"PYTHONPATH": path, "PATH": "/usr/bin:/bin", "HOME": str(Path.home())},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
