"""The leaderboard, a row per scenario, sensor and estimator, and median errors over the noise.

Quantiles are over all attempts, with failures at infinity: the median is, if most failed.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from olne_bench.bench.judge.metrics.cosine_error import CosineError
from olne_bench.bench.judge.metrics.declaration import MetricDeclaration, declare
from olne_bench.bench.report.statistics.attempts import (
    NO_ATTEMPTS,
    attempts_of,
    errors_of,
    measured,
    places_of,
    quantile,
)
from olne_bench.bench.report.statistics.intervals import mean_by_seed, median_interval
from olne_bench.bench.report.statistics.score import ALL
from olne_bench.bench.report.study import (
    IDENTIFIABLE,
    USUAL,
    Study,
    compared,
    in_table,
    primary,
    scored,
)
from olne_bench.estimators.protocol import FIT_LEVEL

#: Largest noise level [m] at which errors are compared with the statistical limit, which is a
#: small-noise expansion. If a study has no level as small, its smallest one is used.
LIMIT_SIGMA = 0.01
#: An estimator is exact without noise if its position error [m] is at most this.
EXACT = 1e-3

_KEY = ["scenario", "sensor", "estimator"]
_LEVEL_KEY = ["scenario", "sensor", "sigma", "estimator"]
_COSINE = declare(CosineError)
_KINDS = ("median", "q25", "q75", "mean", "mean_low", "mean_high")

#: Columns of trials as arrays, by name.
Columns = dict[str, np.ndarray]


def leaderboard(
    trials: pd.DataFrame, scores: pd.DataFrame | None = None, study: Study = USUAL
) -> pd.DataFrame:
    """Summarise trials, optionally with ``identifiable_cosine_error``, and a ``score_table``.

    Columns: ``scenario, sensor, estimator``; ``trials, failures, published_failures`` (with their
    ``count``); ``skipped, harness_errors``, which are no attempts; ``exact``, the share of trials
    without noise with a position error up to ``EXACT``. For each metric with values: median,
    quartiles and mean with its 95 % interval over seeds, in which a failure counts as ``worst``; or
    ``_share`` and ``_trials`` that have a value; ``_score, _score_low, _score_high`` of those who
    rank, and of floors. ``refuted``, the share of tested trials whose residuals noise does not
    explain, at ``FIT_LEVEL``; ``limit_ratio``, the mean cosine error over its limit for small
    noise; the median time, infinite for attempts that did not end. Rows of a scenario and sensor
    are sorted by the primary metric's score, then median; floors come last.
    """
    metrics = in_table((*study.metrics, IDENTIFIABLE), trials)
    return scored_rows(summaries(trials, study), metrics, scores, study)


def summaries(trials: pd.DataFrame, study: Study = USUAL) -> pd.DataFrame:
    """The rows of a leaderboard, without scores and in no order."""
    metrics = in_table((*study.metrics, IDENTIFIABLE), trials)
    columns = _columns(trials, metrics, study)
    rows = [
        dict(zip(_KEY, place, strict=True)) | _summary(_rows(columns, own), metrics)
        for place, own in places_of(trials, _KEY).items()
    ]
    return pd.DataFrame(rows, columns=list(rows[0]) if rows else [])


def scored_rows(
    table: pd.DataFrame,
    metrics: Sequence[MetricDeclaration],
    scores: pd.DataFrame | None = None,
    study: Study = USUAL,
) -> pd.DataFrame:
    """A leaderboard from ``summaries`` of one scenario or more: with scores, and sorted."""
    if table.empty:
        return table
    table = _filled(table, metrics)
    for metric in scored(metrics):
        table = table if scores is None else _with_scores(table, scores, metric.name, study)
    first = primary(metrics)
    others = [f"{metric.name}_median" for metric in compared(metrics) if metric != first]
    best = [f"{first.name}_{kind}" for kind in ("score", "median")] if first else []
    order = ["scenario", "sensor", "floor", *best, "failures", *others, "estimator"]
    ordered = table.assign(floor=table["estimator"].map(study.is_floor))
    ordered = ordered.sort_values([n for n in order if n in ordered], ignore_index=True)
    return ordered.drop(columns="floor")


def _with_scores(
    table: pd.DataFrame, scores: pd.DataFrame, error: str, study: Study
) -> pd.DataFrame:
    """Rows with the scores by an error of those who rank, and of floors."""
    shown = scores["ranked"] | scores["estimator"].map(study.is_floor).astype(bool)
    of_cells = (scores["error"] == error) & (scores["sensor"] != ALL) & shown
    own = scores[of_cells].set_index(_KEY)[["score", "score_low", "score_high"]]
    return table.join(own.add_prefix(f"{error}_"), on=_KEY)


def _filled(table: pd.DataFrame, metrics: Sequence[MetricDeclaration]) -> pd.DataFrame:
    """Rows of several scenarios with their columns in order; without a value there is no trial."""
    known = {metric.name: ("share", "trials") if metric.is_share else _KINDS for metric in metrics}
    shown = [f"{name}_{kind}" for name, kinds in known.items() for kind in kinds]
    shown = [name for name in shown if name in table]
    measured_last = ["refuted", "limit_ratio", "solve_seconds_median"]
    others = [name for name in table if name not in {*shown, *measured_last}]
    shares = dict.fromkeys((name for name in shown if name.endswith("_trials")), int)
    filled = table[[*others, *shown, *measured_last]].fillna(dict.fromkeys(shares, 0))
    return filled.astype(shares).copy()  # in one block again: of many, pandas warns


def _columns(trials: pd.DataFrame, metrics: Sequence[MetricDeclaration], study: Study) -> Columns:
    """What tables need of trials: pandas takes long to choose rows of many small groups."""
    found = {name: trials[name].to_numpy() for name in ("count", "seed", "sigma")}
    found["status"] = trials["status"].to_numpy(object)
    if "published_forward" in trials:
        found["published failure"] = published_failures(trials)
    for name in (
        "solve_seconds",
        "fit_p",
        "cosine_limit",
        *(m.name for m in metrics if m.is_share),
    ):
        found[name] = _numbers(trials, name)
    for metric in metrics:
        found[_about(metric)] = measured(trials, metric, study).to_numpy(bool)
    cosine = [_COSINE] if _COSINE.name in trials else []
    for metric in (*cosine, *(m for m in metrics if not m.is_share)):
        found[metric.name] = errors_of(trials, metric)
    exact = (found["status"] == "ok") & (_numbers(trials, "position_error") <= EXACT)
    found["exact"] = np.where("position_error" in trials, exact, np.nan)
    return found


def _numbers(trials: pd.DataFrame, name: str) -> np.ndarray:
    """A column as numbers, NaN if there is none."""
    if name not in trials:
        return np.full(len(trials), np.nan)
    return trials[name].to_numpy(float, na_value=np.nan)


def _about(metric: MetricDeclaration) -> str:
    """Name of the column that says which rows a metric measures."""
    return f"{metric.name} measures"


def _rows(columns: Columns, chosen: np.ndarray) -> Columns:
    return {name: column[chosen] for name, column in columns.items()}


def _summary(group: Columns, metrics: Sequence[MetricDeclaration]) -> dict[str, float | int]:
    status, count = group["status"], group["count"]
    attempts = _rows(group, ~np.isin(status, NO_ATTEMPTS))
    clean = _rows(attempts, attempts["sigma"] == 0)
    summary: dict[str, float | int] = {
        "trials": int(attempts["count"].sum()),
        "failures": int(attempts["count"][attempts["status"] != "ok"].sum()),
        "published_failures": int(attempts["count"][attempts["published failure"]].sum()),
        "skipped": int(count[status == "skipped"].sum()),
        "harness_errors": int((status == "harness_error").sum()),
        "exact": _mean(clean["exact"], clean["count"]),
    }
    for metric in metrics:
        rows = _rows(attempts, attempts[_about(metric)])
        summary |= _share(rows, metric) if metric.is_share else _error(rows, metric)
    fits = attempts["fit_p"][~np.isnan(attempts["fit_p"])]
    summary["refuted"] = float((fits < FIT_LEVEL).mean()) if len(fits) else np.nan
    summary["limit_ratio"] = _limit_ratio(attempts)
    times = attempts["solve_seconds"]  # none of attempts that were stopped or crashed
    times = np.where(np.isnan(times), np.inf, times)
    summary["solve_seconds_median"] = quantile(times, attempts["count"], 0.5)
    return summary


def _mean(values: np.ndarray, count: np.ndarray) -> float:
    """Mean of values that stand for ``count`` trials each; NaN if there are none."""
    return float(np.average(values, weights=count)) if len(values) else float("nan")


def _error(attempts: Columns, metric: MetricDeclaration) -> dict[str, float | int]:
    """Quantiles and mean of an error over all attempts, failures included."""
    values, count, worst = attempts[metric.name], attempts["count"], metric.worst
    mean = mean_by_seed(np.minimum(values, worst), attempts["seed"], count)
    quantiles = [quantile(values, count, share) for share in (0.5, 0.25, 0.75)]
    found = (*quantiles, mean.estimate, mean.low, float(np.minimum(mean.high, worst)))
    return {f"{metric.name}_{kind}": value for kind, value in zip(_KINDS, found, strict=True)}


def published_failures(attempts: pd.DataFrame) -> np.ndarray:
    """Which rows the published study counts as failed, (rows,) bool: no estimate, or no motion.

    Its single solve of the forward game may not converge even if a root exists.
    """
    failed = attempts["status"].ne("ok") | attempts["published_forward"].eq(0)
    return failed.to_numpy(bool)


def _share(attempts: Columns, metric: MetricDeclaration) -> dict[str, float | int]:
    """Mean of a share over attempts that have a value, and the number of these attempts."""
    told = _rows(attempts, ~np.isnan(attempts[metric.name]))
    share = _mean(told[metric.name], told["count"])
    return {f"{metric.name}_share": share, f"{metric.name}_trials": int(told["count"].sum())}


def _limit_ratio(attempts: Columns) -> float:
    if _COSINE.name not in attempts:
        return float("nan")
    sigma, limits = attempts["sigma"], attempts["cosine_limit"]
    most = max(LIMIT_SIGMA, sigma[sigma > 0].min(initial=np.inf))
    known = (sigma > 0) & (sigma <= most) & np.isfinite(limits) & (limits > 0)
    errors = np.minimum(attempts[_COSINE.name][known], _COSINE.worst)
    return _mean(errors / limits[known], attempts["count"][known])


def errors_by_noise(
    trials: pd.DataFrame,
    study: Study = USUAL,
    metrics: Sequence[MetricDeclaration] | None = None,
) -> pd.DataFrame:
    """Medians over the draws of one noise level, which are independent; failures rank last.

    Columns: ``scenario, sensor, sigma, estimator, attempts, failures``; of each metric, by default
    those that are compared, ``_median, _low, _high`` (95 %, ``intervals.median_interval``).
    """
    metrics = in_table(compared(study.metrics), trials) if metrics is None else metrics
    attempts = attempts_of(trials)
    columns = _columns(attempts, metrics, study)
    rows = [
        dict(zip(_LEVEL_KEY, place, strict=True)) | _medians(_rows(columns, own), metrics)
        for place, own in places_of(attempts, _LEVEL_KEY).items()
    ]
    names = [f"{metric.name}_{end}" for metric in metrics for end in ("median", "low", "high")]
    return pd.DataFrame(rows, columns=[*_LEVEL_KEY, "attempts", "failures", *names])


def _medians(attempts: Columns, metrics: Sequence[MetricDeclaration]) -> dict[str, float | int]:
    count, failed = attempts["count"], attempts["status"] != "ok"
    found: dict[str, float | int] = {"attempts": count.sum(), "failures": count[failed].sum()}
    for metric in metrics:
        rows = _rows(attempts, attempts[_about(metric)])
        median = median_interval(np.repeat(rows[metric.name], rows["count"]))
        found |= median.columns(metric.name, "median")
    return found
