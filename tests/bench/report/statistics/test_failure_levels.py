"""Attempts and failures by noise level, counted by hand."""

import pandas as pd

from olne_bench.bench.report.statistics.failure_levels import failure_levels


def test_attempts_and_failures_are_counted() -> None:
    names = ["sigma", "status", "count"]
    rows = [
        (0.0, "ok", 40),
        (0.1, "ok", 1),
        (0.1, "failed_forward", 1),
        (0.1, "timeout", 1),
        (0.2, "skipped", 1),
        (0.2, "harness_error", 1),
        (0.3, "crash", 7),
    ]
    trials = pd.DataFrame(rows, columns=names).assign(scenario="s", sensor="full", estimator="a")
    table = failure_levels(trials)
    assert list(table) == ["scenario", "sensor", "sigma", "estimator", "attempts", "failures"]
    assert table[["sigma", "attempts", "failures"]].to_numpy().tolist() == [
        [0.0, 40, 0],
        [0.1, 3, 2],
        [0.3, 7, 7],
    ]
