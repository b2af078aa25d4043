"""Runs with hostile plugins, as a user would start them."""

import os
import secrets
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
import psutil
from corpus import HEADER, SLEEPER, Hostile

SUITE = """
name = "hostile"
scenarios = ["two_player"]
sensors = ["full"]
sigmas = [0.05]
seeds = 1
time_limit = {limit}
estimators = ["uniform"]
"""

NEIGHBOUR = """
import json
from types import SimpleNamespace

class Zebra:
    name = "Zebra"
    def estimate(self, problem, observation, *, rng, budget):
        return SimpleNamespace(weights=rng.uniform(0.5, 1, (2, 4)), message=json.dumps([1]))
"""

MARK = "OLNE_BENCH_HOSTILE"


class Run:
    """A run with plugins, and its results.

    Attributes:
        code: exit code.
        said: text on standard output and error.
        rows: rows by the estimator's label; empty if the run was refused.
        left: command lines of processes that are left.
    """

    def __init__(
        self,
        folder: Path,
        plugins: Sequence[Path | str],
        *options: str,
        limit: float = 4.0,
        suite: str = SUITE,
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self.out = folder, folder / "out"
        path = folder / "hostile.toml"
        path.write_text(suite.format(limit=limit))
        neighbour = folder / "neighbour.py"
        neighbour.write_text(NEIGHBOUR)
        words = ["run", str(path), "--out", str(self.out), "--no-figures", "--memory", "1"]
        for plugin in (*plugins, neighbour):
            words += ["--plugin", str(plugin)]
        mark = secrets.token_hex(8)
        done = subprocess.run(
            [sys.executable, "-m", "olne_bench", *words, *options],
            env=os.environ | {MARK: mark},
            capture_output=True,
            timeout=500,
            check=False,
        )
        self.code = done.returncode
        self.said = (done.stdout + done.stderr).decode(errors="replace")
        self.left = _left(mark)
        self.rows = pd.DataFrame()
        table = self.out / "trials.parquet"
        if table.is_file():
            rows = pd.read_parquet(table).drop(columns="solve_seconds")
            self.rows = rows.set_index("estimator", drop=False)

    def neighbours(self) -> pd.DataFrame:
        """Rows of the harmless estimators."""
        return self.rows.loc[["uniform", "Zebra"]]


def write(folder: Path, group: Sequence[Hostile]) -> list[str]:
    """Write plugins of a group into files; return their references."""
    folder.mkdir(parents=True, exist_ok=True)
    together = [one for one in group if not one.alone]
    shared = folder / "hostile.py"
    shared.write_text(HEADER + "".join(one.code() for one in together))
    references = [f"{shared}:{one.name}" for one in together]
    for one in group:
        if one.alone:
            home = folder / one.name
            home.mkdir()
            for name, content in one.beside.items():
                (home / name).write_text(content)
            (home / "hostile.py").write_text(HEADER + one.code())
            references.append(f"{home / 'hostile.py'}:{one.name}")
    return references


def _left(mark: str) -> list[str]:
    """Processes of a run that still run, except those that are just ending."""
    end = time.monotonic() + 5
    while (found := _alive(mark)) and time.monotonic() < end:
        time.sleep(0.2)
    return found


def _alive(mark: str) -> list[str]:
    found = []
    for process in psutil.process_iter():
        try:
            line = process.cmdline()
            mine = process.environ().get(MARK) == mark
        except psutil.Error:
            continue
        if mine or SLEEPER in line:
            found.append(" ".join(line))
    return found
