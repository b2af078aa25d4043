"""Whether two runs of the joint method found the same optima, sequence by sequence.

    olne-bench run scripts/paper_ipopt.toml --out runs/ipopt      (half an hour)
    python scripts/same_optima.py runs/ipopt runs/paper

Prints, per scenario and view: how many sequences have the same objective (to a relative 1e-6), how
far the weights of those are apart, how often the second run's objective is lower or higher, and
the medians of both leaderboards.
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd

KEY = ["scenario", "view", "sigma", "seed"]
SAME, NOTHING = 1e-6, 1e-12  # relative and absolute difference of objectives


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", type=Path, nargs=2, help="folders of two runs")
    options = parser.parse_args()
    first, second = (_joint(folder) for folder in options.runs)
    rows = first.merge(second, on=KEY, suffixes=("_1", "_2"))
    table = rows.groupby(KEY[:2]).apply(_compare)
    print(table.to_string(float_format=lambda value: f"{value:.3g}"))


def _joint(folder: Path) -> pd.DataFrame:
    trials = pd.read_parquet(folder / "trials.parquet")
    joint = trials[trials.estimator.str.startswith("kkt_constrained") & (trials.status == "ok")]
    return joint[[*KEY, "count", "objective", "weights", "cosine_error", "position_error"]]


def _compare(rows: pd.DataFrame) -> pd.Series:
    margin = SAME * rows.objective_1 + NOTHING
    same = (rows.objective_2 - rows.objective_1).abs() <= margin
    apart = _apart(rows[same])
    return pd.Series(
        {
            "sequences": len(rows),
            "same %": 100 * same.mean(),
            "weights apart": apart,
            "lower %": 100 * (rows.objective_2 < rows.objective_1 - margin).mean(),
            "higher %": 100 * (rows.objective_2 > rows.objective_1 + margin).mean(),
            "higher by 1e-4 %": 100
            * (rows.objective_2 > rows.objective_1 * (1 + 1e-4) + NOTHING).mean(),
            "cosine 1": rows.cosine_error_1.median(),
            "cosine 2": rows.cosine_error_2.median(),
            "position 1 [m]": rows.position_error_1.median(),
            "position 2 [m]": rows.position_error_2.median(),
        }
    )


def _apart(rows: pd.DataFrame) -> float:
    """Largest difference of any weight."""
    pairs = zip(rows.weights_1, rows.weights_2, strict=True)
    return max(np.abs(np.stack(one) - np.stack(two)).max() for one, two in pairs)


if __name__ == "__main__":
    main()
