"""The leaderboard: one row per scenario, sensor and estimator, over all attempts.

A failure has no error, so it ranks worse than any: quantiles are taken over all attempts with
failures at infinity, and a median of ``inf`` says that more than half of the attempts failed.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from olne_bench.bench.judge.metrics.cosine_error import CosineError
from olne_bench.bench.judge.metrics.declaration import MetricDeclaration, declare
from olne_bench.bench.report.measures import IDENTIFIABLE, compared, in_table, primary
from olne_bench.bench.report.statistics.attempts import (
    attempts_of,
    errors_of,
    measured,
    quantile,
)
from olne_bench.bench.report.statistics.estimator_comparison import ranks
from olne_bench.bench.report.statistics.intervals import mean_by_seed
from olne_bench.bench.report.study import USUAL, Study

#: Largest noise level [m] at which errors are compared with the statistical limit, which is a
#: small-noise expansion. If a study has no level as small, its smallest one is used.
LIMIT_SIGMA = 0.01

_KEY = ["scenario", "sensor", "estimator"]
_KINDS = ("median", "q25", "q75", "mean", "mean_low", "mean_high")


def leaderboard(
    trials: pd.DataFrame, comparisons: pd.DataFrame | None = None, study: Study = USUAL
) -> pd.DataFrame:
    """Summarise trials.

    Args:
        trials: rows as in ``trials.parquet``, optionally with ``identifiable_cosine_error``, for
            which only rows with a value count.
        comparisons: from ``bench.report.statistics.estimator_comparison``, for ranks.
        study: study of the run.

    Returns:
        One row per (scenario, sensor, estimator): ``trials``, ``failures`` and
        ``published_failures`` (rows counted with their ``count``), ``skipped`` and
        ``harness_errors`` (which are not attempts); for each metric with values the median,
        quartiles and mean with its 95 % interval over seeds, or ``_share`` and ``_trials`` (number
        of trials with a value); ``limit_ratio`` (mean cosine error over its statistical limit for
        small noise); the median time, in which attempts that did not end are infinite; and ranks
        with ties by the metrics that are compared. In means, a failure counts as the largest
        possible error, such as 1 for angles and infinity for positions. Rows of a scenario and
        sensor are sorted by their rank in the primary metric, the position error, then by its
        median.
    """
    metrics = in_table((*study.metrics, IDENTIFIABLE), trials)
    return ranked_rows(summaries(trials, study), metrics, comparisons)


def summaries(trials: pd.DataFrame, study: Study = USUAL) -> pd.DataFrame:
    """The rows of a leaderboard, without ranks and in no order."""
    metrics = in_table((*study.metrics, IDENTIFIABLE), trials)
    about = {metric.name: measured(trials, metric, study) for metric in metrics}
    rows = [
        dict(zip(_KEY, key, strict=True))
        | _counts(group)
        | _measures(attempts_of(group), metrics, about)
        for key, group in trials.groupby(_KEY, sort=True)
    ]
    return pd.DataFrame(rows, columns=list(rows[0]) if rows else [])


def ranked_rows(
    table: pd.DataFrame,
    metrics: Sequence[MetricDeclaration],
    comparisons: pd.DataFrame | None = None,
) -> pd.DataFrame:
    """A leaderboard from its rows: with ranks, if there are comparisons, and sorted.

    Args:
        table: from ``summaries``, of one scenario or more.
        metrics: metrics of the whole table.
        comparisons: as in ``leaderboard``.
    """
    if table.empty:
        return table
    table = _filled(table, metrics)
    ranked = compared(metrics)
    if comparisons is not None:
        for metric in ranked:
            table[f"{metric.name}_rank"] = ranks(comparisons, table, metric.name)
    first = primary(metrics)
    others = [f"{metric.name}_median" for metric in ranked if metric != first]
    best = [f"{first.name}_{kind}" for kind in ("rank", "median")] if first else []
    best = [name for name in best if name in table]
    order = ["scenario", "sensor", *best, "failures", *others, "estimator"]
    return table.sort_values(order, ignore_index=True)


def _filled(table: pd.DataFrame, metrics: Sequence[MetricDeclaration]) -> pd.DataFrame:
    """Rows of several scenarios with their columns in order; without a value there is no trial."""
    shown = [name for metric in metrics for name in _columns(metric) if name in table]
    measured_last = ["limit_ratio", "solve_seconds_median"]
    others = [name for name in table if name not in {*shown, *measured_last}]
    shares = [name for name in shown if name.endswith("_trials")]
    table = table[[*others, *shown, *measured_last]]
    return table.assign(**{name: table[name].fillna(0).astype(int) for name in shares})


def _columns(metric: MetricDeclaration) -> list[str]:
    kinds = ("share", "trials") if metric.is_share else _KINDS
    return [f"{metric.name}_{kind}" for kind in kinds]


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
    }


def _measures(
    attempts: pd.DataFrame, metrics: list[MetricDeclaration], about: dict[str, pd.Series]
) -> dict[str, float | int]:
    summary: dict[str, float | int] = {}
    for metric in metrics:
        rows = attempts[about[metric.name].reindex(attempts.index)]
        summary |= _share(rows, metric) if metric.is_share else _error(rows, metric)
    summary["limit_ratio"] = _limit_ratio(attempts)
    count = attempts["count"].to_numpy()
    summary["solve_seconds_median"] = quantile(_times(attempts), count, 0.5)
    return summary


def _error(attempts: pd.DataFrame, metric: MetricDeclaration) -> dict[str, float | int]:
    """Quantiles and mean of an error over all attempts, failures included."""
    values, count = errors_of(attempts, metric), attempts["count"].to_numpy()
    seeds = attempts["seed"].to_numpy()
    quantiles = {
        f"{metric.name}_{name}": quantile(values, count, share)
        for name, share in (("median", 0.5), ("q25", 0.25), ("q75", 0.75))
    }
    mean = mean_by_seed(np.minimum(values, metric.worst), seeds, count)
    return quantiles | {
        f"{metric.name}_mean": mean.estimate,
        f"{metric.name}_mean_low": mean.low,
        f"{metric.name}_mean_high": float(np.minimum(mean.high, metric.worst)),
    }


def published_failures(attempts: pd.DataFrame) -> np.ndarray:
    """Which rows the published study would count as failed, (rows,) bool.

    Either the estimator fails, or the study's single solve of the forward game does not converge,
    even if a root exists.
    """
    failed = attempts["status"].ne("ok") | attempts["published_forward"].eq(0)
    return failed.to_numpy(bool)


def _times(attempts: pd.DataFrame) -> np.ndarray:
    """Times [s]; infinite for attempts that were stopped or crashed."""
    return attempts["solve_seconds"].fillna(np.inf).to_numpy(float)


def _share(attempts: pd.DataFrame, metric: MetricDeclaration) -> dict[str, float | int]:
    """Mean of a share over attempts that have a value, and the number of these attempts."""
    told = attempts[attempts[metric.name].notna()]
    number = int(told["count"].sum())
    share = np.average(told[metric.name].to_numpy(float), weights=told["count"]) if number else None
    return {
        f"{metric.name}_share": float("nan") if share is None else float(share),
        f"{metric.name}_trials": number,
    }


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
