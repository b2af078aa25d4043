"""Median errors, attempts and failures by noise level, counted by hand."""

import numpy as np
import pandas as pd

from olne_bench.bench.report.leaderboard import errors_by_noise


def trials_of(rows: list[tuple[float, str, int, float]]) -> pd.DataFrame:
    names = ["sigma", "status", "count", "position_error"]
    table = pd.DataFrame(rows, columns=names).assign(scenario="s", sensor="full", estimator="a")
    return table.assign(seed=range(len(table)))


def test_attempts_and_failures_are_counted() -> None:
    table = errors_by_noise(
        trials_of(
            [
                (0.0, "ok", 40, 0.5),
                (0.1, "ok", 1, 0.5),
                (0.1, "failed_forward", 1, np.nan),
                (0.1, "timeout", 1, np.nan),
                (0.2, "skipped", 1, np.nan),
                (0.2, "harness_error", 1, np.nan),
                (0.3, "crash", 7, np.nan),
            ]
        )
    )
    assert table[["sigma", "attempts", "failures"]].to_numpy().tolist() == [
        [0.0, 40, 0],
        [0.1, 3, 2],
        [0.3, 7, 7],
    ]


def test_medians_lie_between_two_of_the_ordered_errors_and_failures_rank_last() -> None:
    errors = [(0.1, "ok", 1, float(k)) for k in range(1, 10)]
    few = [(0.2, "ok", 1, 1.0), (0.2, "timeout", 1, np.nan), (0.2, "timeout", 1, np.nan)]
    table = errors_by_noise(trials_of([*errors[::-1], (0.1, "timeout", 1, np.nan), *few]))
    shown = table[[f"position_error_{end}" for end in ("median", "low", "high")]].to_numpy()
    # Of ten values, the second and the ninth enclose the median in 97.9 % of cases.
    np.testing.assert_array_equal(shown, [[5.5, 2.0, 9.0], [np.inf, np.nan, np.nan]])
