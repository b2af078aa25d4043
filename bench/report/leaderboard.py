"""The leaderboard, a row per scenario, sensor and estimator, and median errors over the noise.

Quantiles are over all attempts, with failures at infinity: the median is, if most failed.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from olne_bench.bench.judge.metrics.cosine_error import CosineError
from olne_bench.bench.judge.metrics.declaration import MetricDeclaration, declare
from olne_bench.bench.report.statistics.attempts import attempts_of, errors_of, measured, quantile
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
_KINDS = ("median", "q25", "q75", "mean", "mean_low", "mean_high")


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
    about = {metric.name: measured(trials, metric, study) for metric in metrics}
    rows = [
        dict(zip(_KEY, key, strict=True))
        | _counts(group)
        | _measures(attempts_of(group), metrics, about)
        for key, group in trials.groupby(_KEY, sort=True)
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
    return table[[*others, *shown, *measured_last]].fillna(dict.fromkeys(shares, 0)).astype(shares)


def _counts(group: pd.DataFrame) -> dict[str, float | int]:
    attempts = attempts_of(group)
    count = attempts["count"].to_numpy()
    failed = (attempts["status"] != "ok").to_numpy()
    return {
        "trials": int(count.sum()),
        "failures": int(count[failed].sum()),
        "published_failures": int(count[published_failures(attempts)].sum()),
        "skipped": int(group.loc[group["status"] == "skipped", "count"].sum()),
        "harness_errors": int((group["status"] == "harness_error").sum()),
        "exact": _exact(attempts[attempts["sigma"] == 0]),
    }


def _mean(values: np.ndarray, count: pd.Series) -> float:
    """Mean of values that stand for ``count`` trials each; NaN if there are none."""
    return float(np.average(values, weights=count)) if len(values) else float("nan")


def _exact(attempts: pd.DataFrame) -> float:
    """Share of attempts without noise that predict exactly."""
    if "position_error" not in attempts:
        return float("nan")
    exact = attempts["status"].eq("ok") & (attempts["position_error"] <= EXACT).fillna(False)
    return _mean(exact.to_numpy(bool), attempts["count"])


def _measures(
    attempts: pd.DataFrame, metrics: list[MetricDeclaration], about: dict[str, pd.Series]
) -> dict[str, float | int]:
    summary: dict[str, float | int] = {}
    for metric in metrics:
        rows = attempts[about[metric.name].reindex(attempts.index)]
        summary |= _share(rows, metric) if metric.is_share else _error(rows, metric)
    fits = attempts["fit_p"].dropna() if "fit_p" in attempts else pd.Series(dtype=float)
    summary["refuted"] = float((fits < FIT_LEVEL).mean())
    summary["limit_ratio"] = _limit_ratio(attempts)
    times = attempts["solve_seconds"].fillna(np.inf)  # of attempts that were stopped or crashed
    count = attempts["count"].to_numpy()
    summary["solve_seconds_median"] = quantile(times.to_numpy(float), count, 0.5)
    return summary


def _error(attempts: pd.DataFrame, metric: MetricDeclaration) -> dict[str, float | int]:
    """Quantiles and mean of an error over all attempts, failures included."""
    values, count = errors_of(attempts, metric), attempts["count"].to_numpy()
    seeds, worst = attempts["seed"].to_numpy(), metric.worst
    mean = mean_by_seed(np.minimum(values, worst), seeds, count)
    quantiles = [quantile(values, count, share) for share in (0.5, 0.25, 0.75)]
    found = (*quantiles, mean.estimate, mean.low, float(np.minimum(mean.high, worst)))
    return {f"{metric.name}_{kind}": value for kind, value in zip(_KINDS, found, strict=True)}


def published_failures(attempts: pd.DataFrame) -> np.ndarray:
    """Which rows the published study counts as failed, (rows,) bool: no estimate, or no motion.

    Its single solve of the forward game may not converge even if a root exists.
    """
    failed = attempts["status"].ne("ok") | attempts["published_forward"].eq(0)
    return failed.to_numpy(bool)


def _share(attempts: pd.DataFrame, metric: MetricDeclaration) -> dict[str, float | int]:
    """Mean of a share over attempts that have a value, and the number of these attempts."""
    told = attempts[attempts[metric.name].notna()]
    share = _mean(told[metric.name].to_numpy(float), told["count"])
    return {f"{metric.name}_share": share, f"{metric.name}_trials": int(told["count"].sum())}


def _limit_ratio(attempts: pd.DataFrame) -> float:
    metric, sigma = declare(CosineError), attempts["sigma"]
    if metric.name not in attempts:
        return float("nan")
    most = max(LIMIT_SIGMA, sigma[sigma > 0].min())
    small = attempts[(sigma > 0) & (sigma <= most)]
    errors = np.minimum(errors_of(small, metric), metric.worst)
    limits = small["cosine_limit"].to_numpy(float)
    known = np.isfinite(limits) & (limits > 0)
    return _mean(errors[known] / limits[known], small["count"][known])


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
    about = {metric.name: measured(trials, metric, study) for metric in metrics}
    rows = [
        dict(zip(_LEVEL_KEY, key, strict=True)) | _medians(group, metrics, about)
        for key, group in attempts_of(trials).groupby(_LEVEL_KEY, sort=True)
    ]
    names = [f"{metric.name}_{end}" for metric in metrics for end in ("median", "low", "high")]
    return pd.DataFrame(rows, columns=[*_LEVEL_KEY, "attempts", "failures", *names])


def _medians(
    attempts: pd.DataFrame, metrics: Sequence[MetricDeclaration], about: dict[str, pd.Series]
) -> dict[str, float | int]:
    failed = attempts.loc[attempts["status"] != "ok", "count"].sum()
    found: dict[str, float | int] = {"attempts": attempts["count"].sum(), "failures": failed}
    for metric in metrics:
        rows = attempts[about[metric.name].reindex(attempts.index)]
        median = median_interval(np.repeat(errors_of(rows, metric), rows["count"]))
        found |= median.columns(metric.name, "median")
    return found
