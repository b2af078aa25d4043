"""Errors of attempts, failures included."""

import numpy as np
import pandas as pd

from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.envs.scenarios import is_family

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


def is_family_label(label: str) -> bool:
    """Whether every seed of the scenario with this label has a draw of its own."""
    try:
        return is_family(ScenarioEntry.from_label(label).name)
    except ValueError:
        return True  # unknown here: the careful choice


def families(trials: pd.DataFrame) -> pd.Series:
    """Which rows are of a family."""
    return trials["scenario"].map({s: is_family_label(s) for s in trials["scenario"].unique()})


def weighed(trials: pd.DataFrame) -> pd.DataFrame:
    """Trials with the ``count`` that rows without noise have among those that were run.

    As stored, such a row stands for all noise draws of its suite. Where a run was asked for a part
    of them, or was stopped, it must not outweigh the others: it counts as often as there are draws
    of the same scenario, view and estimator at other levels, and at least once.
    """
    shared = trials["count"] > 1
    key = ["scenario", "view", "estimator"]
    draws = trials[~shared].groupby(key)["seed"].nunique()
    own = pd.MultiIndex.from_frame(trials.loc[shared, key])
    count = trials["count"].copy()
    count[shared] = draws.reindex(own).fillna(1).to_numpy(int)
    return trials.assign(count=count)


def noisy(attempts: pd.DataFrame) -> pd.DataFrame:
    """Attempts that chance has a part in: not those without noise, unless of a family's draws."""
    return attempts[(attempts["count"] == 1) & ((attempts["sigma"] > 0) | families(attempts))]


def lacks_held_out(trials: pd.DataFrame) -> pd.Series:
    """Which rows have no held-out error since nothing could be held out.

    There may be no equilibrium near a draw to predict, so none of its estimates has an error. A
    failed estimate is a failure there, too.
    """
    draw = trials["seed"].where(families(trials), -1)
    some = trials["held_out_error"].notna().groupby([trials["scenario"], draw]).transform("any")
    return ~some & (trials["status"] == "ok")


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
