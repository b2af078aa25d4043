"""A small study with its own estimators, and a way to run it as a user would."""

import io
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pandas as pd
import pytest
from playwright.sync_api import Browser, Error, sync_playwright

from olne_bench.bench.commands.cli import main
from olne_bench.bench.judge.players import Answer, PlayerFault, PlayerTask, Staff
from olne_bench.bench.judge.trials import judge
from olne_bench.bench.plan import fingerprint, versions
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import Trial
from olne_bench.bench.run import player
from olne_bench.bench.run.metric_process import MetricProcess
from olne_bench.bench.run.store import read_store
from olne_bench.bench.text import clip, describe_error

SUITE = """
name = "small"
scenarios = ["two_player"]
sensors = ["full"]
sigmas = [0.01, 0.1]
seeds = 4
time_limit = 20.0
estimators = ["uniform"]
"""

PLUGIN = """
import time
from types import SimpleNamespace
import numpy as np

class Drawn:
    name = "Drawn"
    def estimate(self, problem, observation, *, rng, budget):
        return SimpleNamespace(weights=rng.uniform(0.5, 1, (2, 4)))

class Fails:
    name = "Fails"
    def estimate(self, problem, observation, *, rng, budget):
        raise RuntimeError("always")

class Slow(Drawn):
    name = "Slow"
    def estimate(self, *args, **kwargs):
        time.sleep(0.4)
        return super().estimate(*args, **kwargs)

class Hangs(Drawn):
    name = "Hangs"
    def estimate(self, *args, **kwargs):
        while True:
            time.sleep(0.1)
"""

#: Functions that cache the code which they have read.
READ_ONCE = (
    fingerprint._imported,
    fingerprint._summary,
    fingerprint._content,
    versions._version,
    versions._scoring,
)


class Study:
    """A folder with a suite, a plugin file and runs."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.suite = folder / "small.toml"
        self.plugin = folder / "plugin.py"
        self.suite.write_text(SUITE)
        self.plugin.write_text(PLUGIN)

    def start(self, *arguments: object, **options: object) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-m", "olne_bench", *map(str, arguments)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            **options,
        )

    def call(self, *arguments: object, code: int = 0) -> str:
        """Run a command in this process, which has imported everything; return its output."""
        for function in READ_ONCE:
            function.cache_clear()  # a new process would read the present code
        said = io.StringIO()
        with redirect_stdout(said), redirect_stderr(said):
            try:
                main([*map(str, arguments)])
                ended = 0
            except SystemExit as error:
                ended = int(error.code or 0)
        assert ended == code, said.getvalue()
        return said.getvalue()

    def call_alone(self, *arguments: object, code: int = 0, **options: object) -> str:
        """Run a command in a new process."""
        process = self.start(*arguments, **options)
        try:
            said, errors = process.communicate(timeout=120)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            raise
        assert process.returncode == code, said + errors
        return said + errors

    def arguments(self, out: str, *plugins: str) -> list[object]:
        words: list[object] = ["run", self.suite, "--no-report", "--out", self.folder / out]
        for name in plugins:
            words += ["--plugin", f"{self.plugin}:{name}"]
        return words

    def run(self, out: str, *plugins: str, options: tuple[str, ...] = (), code: int = 0) -> str:
        """Run the suite, by default with one job, because processes are slow to start."""
        return self.call(*self.arguments(out, *plugins), "--jobs", 1, *options, code=code)

    def rows(self, out: str) -> pd.DataFrame:
        """The rows of a run without times; weights are text, which can be compared."""
        with read_store(self.folder / out) as store:
            rows = store.table().to_pandas()
        return rows.drop(columns="solve_seconds")


class PlayerHere:
    """A player without a process, for harmless estimators."""

    def estimate(self, task: PlayerTask) -> Answer:
        try:
            prepared = player.prepare(*player.told(task))
            if prepared.declined is not None:
                return Answer(declined=prepared.declined)
            answered = player.estimate(task.observations, task.time_limit)
        except BaseException as error:  # as a process would tell it
            raise PlayerFault("crash", describe_error(error)) from error
        if answered.estimate is None:
            raise PlayerFault("invalid", clip(answered.malformed), 0.0)
        return Answer(estimate=answered.estimate)


@pytest.fixture(scope="session")
def judged() -> Iterator[Callable[[Trial], Outcome]]:
    """Judges a trial in this process."""
    metrics = MetricProcess(memory=None, hidden=None)
    yield lambda trial: judge(trial, Staff(PlayerHere(), metrics))
    metrics.stop()


@pytest.fixture
def study(tmp_path: Path) -> Study:
    return Study(tmp_path)


@pytest.fixture(scope="module")
def lasting_study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """For tests that share a run and change copies of it."""
    return Study(tmp_path_factory.mktemp("study"))


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    found = shutil.which("chromium") or shutil.which("google-chrome")
    if found is None:
        pytest.skip("needs Chromium (Debian: apt install chromium)")
    with sync_playwright() as play:
        try:
            browser = play.chromium.launch(executable_path=found, args=["--no-sandbox"])
        except Error as error:
            pytest.skip(f"Chromium does not start: {error}")
        yield browser
        browser.close()
