"""The leaderboard, a row per scenario, sensor and estimator, and median errors over the noise.

A failure has no error, so it ranks worse than any: quantiles are taken over all attempts with
failures at infinity, and a median of ``inf`` says that more than half of the attempts failed.
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

    Columns: ``scenario, sensor, estimator``; ``trials``, ``failures`` and ``published_failures``
    (rows counted with their ``count``), ``skipped`` and ``harness_errors`` (which are not
    attempts); the share of ``exact`` trials without noise, whose position error is at most
    ``EXACT``; for each metric with values the median, quartiles and mean with its 95 % interval
    over seeds, or ``_share`` and ``_trials`` (number of trials with a value), and ``_score`` with
    ``_score_low`` and ``_score_high``, which those who do not rank lack, floors apart;
    ``refuted`` (share of the tested trials at which noise does not explain the residuals, at
    ``FIT_LEVEL``); ``limit_ratio`` (mean cosine error over its limit for small noise); the median
    time, in which attempts that did not end are infinite. In means, a failure counts as the largest
    possible error, such as 1 for angles and infinity for positions. Rows of a scenario and sensor
    are sorted by their score by the primary metric, the position error, then by its median; floors
    come last.
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
    kinds = ["score", "score_low", "score_high"]
    own = scores.loc[of_cells, [*_KEY, *kinds]]
    return table.merge(own.rename(columns={k: f"{error}_{k}" for k in kinds}), how="left", on=_KEY)


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


def _exact(attempts: pd.DataFrame) -> float:
    """Share of attempts without noise that predict exactly; NaN if there are none."""
    if attempts.empty or "position_error" not in attempts:
        return float("nan")
    exact = attempts["status"].eq("ok") & (attempts["position_error"] <= EXACT).fillna(False)
    return float(np.average(exact.to_numpy(bool), weights=attempts["count"]))


def _refuted(attempts: pd.DataFrame) -> float:
    """Share of tested attempts whose model does not fit; NaN if none was tested."""
    if "fit_p" not in attempts:
        return float("nan")
    tested = attempts[attempts["fit_p"].notna()]
    return float((tested["fit_p"] < FIT_LEVEL).mean()) if len(tested) else float("nan")


def _measures(
    attempts: pd.DataFrame, metrics: list[MetricDeclaration], about: dict[str, pd.Series]
) -> dict[str, float | int]:
    summary: dict[str, float | int] = {}
    for metric in metrics:
        rows = attempts[about[metric.name].reindex(attempts.index)]
        summary |= _share(rows, metric) if metric.is_share else _error(rows, metric)
    summary["refuted"] = _refuted(attempts)
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
    """Which rows the published study would count as failed, (rows,) bool.

    Either the estimator fails, or the study's single solve of the forward game does not converge,
    even if a root exists.
    """
    failed = attempts["status"].ne("ok") | attempts["published_forward"].eq(0)
    return failed.to_numpy(bool)


def _share(attempts: pd.DataFrame, metric: MetricDeclaration) -> dict[str, float | int]:
    """Mean of a share over attempts that have a value, and the number of these attempts."""
    told = attempts[attempts[metric.name].notna()]
    number, share = int(told["count"].sum()), float("nan")
    if number:
        share = float(np.average(told[metric.name].to_numpy(float), weights=told["count"]))
    return {f"{metric.name}_share": share, f"{metric.name}_trials": number}


def _limit_ratio(attempts: pd.DataFrame) -> float:
    metric, sigma = declare(CosineError), attempts["sigma"]
    if metric.name not in attempts:
        return float("nan")
    most = max(LIMIT_SIGMA, sigma[sigma > 0].min())
    small = attempts[(sigma > 0) & (sigma <= most)]
    errors = np.minimum(errors_of(small, metric), metric.worst)
    limits = small["cosine_limit"].to_numpy(float)
    known = np.isfinite(limits) & (limits > 0)
    if not known.any():
        return float("nan")
    return float(np.average((errors[known] / limits[known]), weights=small["count"][known]))


def errors_by_noise(
    trials: pd.DataFrame,
    study: Study = USUAL,
    metrics: Sequence[MetricDeclaration] | None = None,
) -> pd.DataFrame:
    """Medians over the draws of one noise level, which are independent.

    One row per (scenario, sensor, noise level, estimator): ``attempts``, ``failures``, and for each
    error, by default those that are compared, ``_median`` with ``_low`` and ``_high``, a 95 %
    interval (``intervals.median_interval``; none below six draws). Failures rank last.
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
    failed = attempts["status"] != "ok"
    found: dict[str, float | int] = {
        "attempts": int(attempts["count"].sum()),
        "failures": int(attempts.loc[failed, "count"].sum()),
    }
    for metric in metrics:
        rows = attempts[about[metric.name].reindex(attempts.index)]
        median = median_interval(np.repeat(errors_of(rows, metric), rows["count"]))
        found[f"{metric.name}_median"] = median.estimate
        found[f"{metric.name}_low"], found[f"{metric.name}_high"] = median.low, median.high
    return found
