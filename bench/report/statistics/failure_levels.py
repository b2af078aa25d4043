"""Attempts and failures by noise level."""

import pandas as pd

from olne_bench.bench.report.statistics.attempts import attempts_of

_CELL = ["scenario", "sensor", "sigma", "estimator"]


def failure_levels(trials: pd.DataFrame) -> pd.DataFrame:
    """Columns ``scenario, sensor, sigma, estimator, attempts, failures``.

    Rows count as often as their ``count``. A failure is an attempt without a prediction.
    """
    attempts = attempts_of(trials)
    counts = attempts["count"]
    told = attempts[_CELL].assign(
        attempts=counts, failures=counts.where(attempts["status"] != "ok", 0)
    )
    return told.groupby(_CELL, as_index=False)[["attempts", "failures"]].sum()
