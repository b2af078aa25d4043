"""Median errors at each noise level, with intervals over draws."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.measures import compared, in_table
from olne_bench.bench.report.statistics.attempts import attempts_of, errors_of, measured
from olne_bench.bench.report.statistics.intervals import median_interval
from olne_bench.bench.report.study import USUAL, Study

_KEY = ["scenario", "sensor", "sigma", "estimator"]


def errors_by_noise(
    trials: pd.DataFrame,
    study: Study = USUAL,
    metrics: Sequence[MetricDeclaration] | None = None,
) -> pd.DataFrame:
    """Medians over the draws of one noise level, which are independent.

    Args:
        trials: rows as in ``trials.parquet``.
        study: study of the run.
        metrics: the errors. Default: those that are compared.

    Returns:
        One row per (scenario, sensor, noise level, estimator): ``attempts``, ``failures``, and for
        each error ``_median`` with ``_low`` and ``_high``, a 95 % interval
        (``intervals.median_interval``; none below six draws). Failures rank last.
    """
    metrics = in_table(compared(study.metrics), trials) if metrics is None else metrics
    about = {metric.name: measured(trials, metric, study) for metric in metrics}
    rows = [
        dict(zip(_KEY, key, strict=True)) | _medians(group, metrics, about)
        for key, group in attempts_of(trials).groupby(_KEY, sort=True)
    ]
    names = [f"{metric.name}_{end}" for metric in metrics for end in ("median", "low", "high")]
    return pd.DataFrame(rows, columns=[*_KEY, "attempts", "failures", *names])


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
