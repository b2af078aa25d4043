"""Check whether two estimators that minimise the squared error found the same optima.

    olne-bench run scripts/paper_ipopt.toml --out runs/ipopt      (half an hour)
    python scripts/same_optima.py runs/ipopt runs/paper
    python scripts/same_optima.py runs/field runs/field --estimators bilevel kkt_constrained

Compares the sequences on which both converge. Prints, per scenario and sensor: how many sequences
have the same objective (to a relative 1e-6), how far their weights are apart, how often the second
one's objective is lower or higher, and the medians of their errors.
"""

from pathlib import Path

import shared
import numpy as np
import pandas as pd

KEY = ["scenario", "sensor", "sigma", "seed"]
SAME, NOTHING = 1e-6, 1e-12  # relative and absolute difference of objectives


def main(runs: tuple[Path, ...], estimators: tuple[str, ...] = ("kkt_constrained",) * 2) -> None:
    """Command line."""
    first, second = map(_solved, runs, estimators)
    rows = first.merge(second, on=KEY, suffixes=("_1", "_2"))
    table = rows.groupby(KEY[:2]).apply(_compare)
    print(table.to_string(float_format=lambda value: f"{value:.3g}"))


def _solved(folder: Path, estimator: str) -> pd.DataFrame:
    trials = pd.read_parquet(folder / "trials.parquet")
    known = trials.estimator.str.split("(").str[0]  # the label without parameters
    ended = trials.status.isin(["ok", "failed_forward"])
    solved = trials[(known == estimator) & ended]
    return solved[[*KEY, "count", "objective", "weights", "cosine_error", "position_error"]]


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
    return max((np.abs(np.stack(one) - np.stack(two)).max() for one, two in pairs), default=np.nan)


if __name__ == "__main__":
    shared.command(main)
