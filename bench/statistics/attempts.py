"""Errors of attempts, failures included."""

import numpy as np
import pandas as pd

#: The estimator that all others must beat: a reference, not a contender.
FLOOR = "uniform"

#: The errors that estimators are compared by.
ERRORS = ("cosine_error", "position_error")

#: The largest error there is. Angles between weights, none of which is negative, end at 90
#: degrees; a prediction can be any number of metres off.
WORST = {
    "cosine_error": 1.0,
    "identifiable_cosine_error": 1.0,
    "position_error": np.inf,
    "held_out_error": np.inf,
}

#: Compared like an error: 1 for an attempt without a prediction, else 0.
FAILURES = "failures"

_PREDICTIONS = ("position_error",)


def attempts_of(trials: pd.DataFrame) -> pd.DataFrame:
    """Trials less those that an estimator declined."""
    return trials[trials["status"] != "skipped"]


def errors_of(attempts: pd.DataFrame, column: str) -> np.ndarray:
    """An error of each row, infinite for failures.

    A forward game without a root (``failed_forward``) is a failure of the prediction only: the
    weights are there and have a cosine error. Of ``FAILURES``, which rows are failures.
    """
    if column == FAILURES:
        return attempts["status"].ne("ok").to_numpy(float)
    valid = ["ok"] if column in _PREDICTIONS else ["ok", "failed_forward"]
    values = attempts[column].to_numpy(dtype=float, na_value=np.nan)
    return np.where(attempts["status"].isin(valid) & np.isfinite(values), values, np.inf)


def quantile(values: np.ndarray, count: np.ndarray, share: float) -> float:
    """Interpolated quantile of values repeated ``count`` times; infinite values rank last."""
    if not len(values):
        return float("nan")
    order = np.argsort(values, kind="stable")
    ends = np.cumsum(count[order])
    position = share * (ends[-1] - 1)
    places = np.searchsorted(ends, [np.floor(position), np.ceil(position)], side="right")
    low, high = values[order][places]
    # inf - inf is undefined, so no interpolation between equal values.
    return float(low if low == high else low + (high - low) * (position % 1))
