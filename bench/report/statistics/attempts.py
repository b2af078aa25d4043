"""Errors of attempts, failures included; those of the harness are no attempts, and apart."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.study import FAILURES, IDENTIFIABLE, USUAL, Study

#: The estimator that all others must beat: a reference, not a contender.
FLOOR = "uniform"

#: Statuses of trials that are not attempts: the estimator declined, or the harness failed.
NO_ATTEMPTS = ("skipped", "harness_error")

_PLACE = ["scenario", "sensor", "estimator"]
_HARNESS = [*_PLACE, "message"]


def attempts_of(trials: pd.DataFrame) -> pd.DataFrame:
    """Trials without those that an estimator declined or the harness failed to judge."""
    return _only(trials, ~trials["status"].isin(NO_ATTEMPTS))


def _only(trials: pd.DataFrame, chosen: pd.Series) -> pd.DataFrame:
    """The chosen rows; no copy if these are all."""
    return trials if chosen.all() else trials[chosen]


def which(labels: pd.Series, holds: Callable[[str], bool]) -> pd.Series:
    """Of which labels something holds, asked once for each label."""
    return labels.map({label: holds(label) for label in labels.unique()}).astype(bool)


def places_of(rows: pd.DataFrame, key: list[str]) -> dict[tuple[Any, ...], np.ndarray]:
    """Positions of the rows that have the same values of some columns, by these values, sorted."""
    found: dict[Any, Any] = rows[key].groupby(key).indices
    return {place: np.asarray(found[place]) for place in sorted(found)}


def weighed(trials: pd.DataFrame) -> pd.DataFrame:
    """Trials in which the ``count`` of rows without noise fits the trials that were run.

    Such a row counts as often as there are draws of the same scenario, sensor and estimator at
    other levels, and at least once.
    """
    shared = trials["count"] > 1
    draws = trials.loc[~shared, [*_PLACE, "seed"]].groupby(_PLACE)["seed"].nunique()
    own = pd.MultiIndex.from_frame(trials.loc[shared, _PLACE])
    count = trials["count"].copy()
    count[shared] = draws.reindex(own).fillna(1).to_numpy(int)
    return trials.assign(count=count)


def noisy(attempts: pd.DataFrame, study: Study = USUAL) -> pd.DataFrame:
    """Attempts that are random: those with noise, and those of a family's draws."""
    drawn = which(attempts["scenario"], study.is_family)
    return _only(attempts, (attempts["count"] == 1) & ((attempts["sigma"] > 0) | drawn))


def measured(trials: pd.DataFrame, metric: MetricDeclaration, study: Study = USUAL) -> pd.Series:
    """Which rows a metric measures: failures, and estimates for which it has a value.

    Where a metric that needs a prediction has no value, the prediction failed, and the row counts,
    unless no estimate of the draw has one. Others do not measure an estimator that never has one.
    """
    if metric == FAILURES:
        return pd.Series(True, trials.index)
    told = trials[metric.name].notna()
    if metric == IDENTIFIABLE:
        return told  # failures have a value, which is infinite
    valid = trials["status"].isin(_valid(metric))
    if metric.needs_prediction:
        draw = trials["seed"].where(which(trials["scenario"], study.is_family), -1)
        told = told.groupby([trials["scenario"], draw]).transform("any")
        return told | ~valid
    who = [trials[name] for name in _PLACE]
    silent = valid.groupby(who).transform("any") & ~told.groupby(who).transform("any")
    return (told | ~valid) & ~silent


def errors_of(attempts: pd.DataFrame, metric: MetricDeclaration) -> np.ndarray:
    """An error of each row, infinite for failures; that of ``FAILURES`` is 1 for them, else 0.

    A forward game without a root (``failed_forward``) is a failure of the prediction only.
    """
    if metric == FAILURES:
        return attempts["status"].ne("ok").to_numpy(float)
    values = attempts[metric.name].to_numpy(dtype=float, na_value=np.nan)
    valid = attempts["status"].isin(_valid(metric)) & np.isfinite(values)
    return np.where(valid, values, np.inf)


def _valid(metric: MetricDeclaration) -> list[str]:
    return ["ok"] if metric.needs_prediction else ["ok", "failed_forward"]


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


def median(values: np.ndarray) -> float:
    """Median of values of which infinite ones rank last."""
    return quantile(values, np.ones(len(values), int), 0.5)


def harness_errors(trials: pd.DataFrame) -> pd.DataFrame:
    """Columns ``scenario, sensor, estimator, message, trials``, the most frequent error first."""
    return _counted(trials[trials["status"] == "harness_error"].fillna({"message": ""}))


def failures(trials: pd.DataFrame) -> pd.DataFrame:
    """The same of attempts that failed, whose messages begin with their status."""
    failed = attempts_of(trials)
    failed = failed[failed["status"] != "ok"].fillna({"message": ""})
    return _counted(failed.assign(message=failed["status"] + ": " + failed["message"]))


def _counted(trials: pd.DataFrame) -> pd.DataFrame:
    if trials.empty:
        return pd.DataFrame(columns=[*_HARNESS, "trials"])
    return most_frequent_first(trials.groupby(_HARNESS).size().rename("trials").reset_index())


def most_frequent_first(table: pd.DataFrame) -> pd.DataFrame:
    """``harness_errors`` or ``failures`` in their order, such as those of several scenarios."""
    order = ["trials", *_HARNESS]
    return table.sort_values(order, ascending=[False, *[True] * 4], ignore_index=True)


def in_words(table: pd.DataFrame, most: int = 5) -> list[str]:
    """The first rows of such a table as lines, and the number of further trials."""
    lines = [
        f"{row.trials} x {row.estimator} on {row.scenario}, {row.sensor}: {row.message}"
        for row in table.head(most).itertuples(index=False)
    ]
    rest = int(table["trials"][most:].sum())
    return [*lines, f"and {rest} more"] if rest else lines
