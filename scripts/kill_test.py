"""Kill driver or workers (-9) at random moments, resume, and compare with an uninterrupted run.

    python scripts/kill_test.py --kills 50
    python scripts/kill_test.py --kills 50 --dask local:2

If a run is complete before all kills are used up, it is compared and another one is started. Exit
code 1 if a table differs from that of the uninterrupted run in any column but times.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
import psutil

RUN = [sys.executable, "-m", "olne_bench", "run", "paper", "--no-figures"]
RUN += ["--scenario", "two_player"]


def main() -> None:
    """Run the test."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seeds", type=int, default=4, help="noise draws of the study")
    parser.add_argument("--dask", help="as for olne-bench run")
    arguments = parser.parse_args()
    run = [*RUN, "--seeds", str(arguments.seeds)]
    killed_run = [*run, "--dask", arguments.dask] if arguments.dask else run
    rng = np.random.default_rng(arguments.seed)
    kills: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        whole = _finished(Path(folder, "whole"), run)
        rounds = 0
        while kills.total() < arguments.kills:
            rounds += 1
            out = Path(folder, f"killed{rounds}")
            kills += _kill(out, killed_run, rng, arguments.kills - kills.total())
            _compare(whole, _finished(out, killed_run))
            print(f"round {rounds}: equal to the uninterrupted run after {_said(kills)}")
    print(f"equal: {len(whole)} rows, {len(whole.columns)} columns, {_said(kills)}")


def _kill(out: Path, run: list[str], rng: np.random.Generator, limit: int) -> Counter[str]:
    """Run into a folder with kills until the run is complete or the kills are used up."""
    kills: Counter[str] = Counter()
    while kills.total() < limit:
        driver = psutil.Popen(
            [*run, "--out", out], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        while kills.total() < limit:
            time.sleep(rng.uniform(0.2, 8.0))
            if driver.poll() is not None:
                break
            victim = _victim(driver, rng)
            kills["driver" if victim == driver else "worker"] += 1
            victim.kill()
        if driver.poll() is None and kills.total() >= limit:
            driver.kill()
        _, errors = driver.communicate()
        if driver.returncode == 0:
            break
        if driver.returncode > 0:
            sys.exit(f"the run ended with {driver.returncode}: {errors.splitlines()[-1]}")
    return kills


def _victim(driver: psutil.Popen, rng: np.random.Generator) -> psutil.Process:
    """The driver in a third of cases, otherwise one of its processes, at any depth."""
    others = driver.children(recursive=True)
    if not others or rng.random() < 1 / 3:
        return driver
    return others[rng.integers(len(others))]


def _finished(out: Path, run: list[str]) -> pd.DataFrame:
    """Complete a run without kills, and return its table."""
    subprocess.run([*run, "--out", out], check=True, capture_output=True)
    return pd.read_parquet(out / "trials.parquet").drop(columns="solve_seconds")


def _compare(whole: pd.DataFrame, killed: pd.DataFrame) -> None:
    try:
        pd.testing.assert_frame_equal(whole, killed, check_exact=True)
    except AssertionError as error:
        if len(whole) == len(killed):
            other = killed[whole["status"] != killed["status"]]
            print(other[["sigma", "seed", "estimator", "status", "message"]].to_string())
        sys.exit(f"the tables differ: {str(error).splitlines()[0]}")


def _said(kills: Counter[str]) -> str:
    return f"{kills['driver']} kills of the driver and {kills['worker']} of workers"


if __name__ == "__main__":
    main()
