"""Kill a run (-9) at random moments, resume it, and compare it with an uninterrupted one.

    python scripts/kill_test.py --kills 10

Exit code 1 if the two tables differ in any column but times.
"""

import argparse
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd

RUN = [sys.executable, "-m", "bench", "run", "quick", "--no-figures", "--jobs", "2"]


def main() -> None:
    """Run the test."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    with tempfile.TemporaryDirectory() as folder:
        whole, killed = Path(folder, "whole"), Path(folder, "killed")
        started = time.monotonic()
        subprocess.run([*RUN, "--out", whole], check=True, capture_output=True)
        duration = time.monotonic() - started
        print(f"uninterrupted run: {duration:.0f} s")
        for number in range(arguments.kills):
            seconds = rng.uniform(1, 2 + 1.5 * duration / arguments.kills)
            process = subprocess.Popen(
                [*RUN, "--out", killed], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
            )
            try:
                process.wait(seconds)
                print(f"kill {number + 1}: the run had ended by itself")
            except subprocess.TimeoutExpired:
                process.send_signal(signal.SIGKILL)
                process.wait()
                print(f"kill {number + 1}: after {seconds:.1f} s")
        subprocess.run([*RUN, "--out", killed], check=True, capture_output=True)
        tables = [
            pd.read_parquet(path / "trials.parquet").drop(columns="solve_seconds")
            for path in (whole, killed)
        ]
    pd.testing.assert_frame_equal(*tables, check_exact=True)
    print(f"equal: {len(tables[0])} rows, {len(tables[0].columns)} columns")


if __name__ == "__main__":
    main()
