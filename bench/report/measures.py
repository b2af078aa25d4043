"""Choose the metrics of a table from the declarations of its run's metrics."""

from collections.abc import Iterable, Sequence

import pandas as pd

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration

#: The metric that ranks estimators if a run has it; else the first metric that is compared.
_USUAL_PRIMARY = "position_error"
#: Errors that have scores although nobody is compared by them: positive, and the less the better.
_ALSO_SCORED = ("held_out_error", "crps", "energy_score")

#: The cosine error without what the data cannot identify. It is computed for a whole run
#: (``statistics.identifiability``), not per trial: what is identifiable is a property of a
#: scenario, all its trajectories and a sensor, and the same for every estimate.
IDENTIFIABLE = MetricDeclaration(
    "identifiable_cosine_error",
    label="identifiable error",
    worst=1.0,
    gated=True,
    negligible=1e-7,
    description="The cosine error less what the data cannot show at 0.01 m.",
)

#: A failure, compared like an error: 1 for an attempt without a prediction, else 0.
FAILURES = MetricDeclaration("failures", worst=1.0)


def compared(metrics: Iterable[MetricDeclaration]) -> list[MetricDeclaration]:
    """The metrics that estimators and runs are compared by."""
    return [metric for metric in metrics if metric.compared]


def scored(metrics: Iterable[MetricDeclaration]) -> list[MetricDeclaration]:
    """The metrics that have scores: errors that are compared, held-out errors, proper scores."""
    return [metric for metric in metrics if metric.compared or metric.name in _ALSO_SCORED]


def primary(metrics: Sequence[MetricDeclaration]) -> MetricDeclaration | None:
    """The metric that estimators are ranked by; None if no metric is compared."""
    known = compared(metrics)
    return next((m for m in known if m.name == _USUAL_PRIMARY), known[0] if known else None)


def in_table(metrics: Iterable[MetricDeclaration], trials: pd.DataFrame) -> list[MetricDeclaration]:
    """The metrics with a value in a table of trials; if all trials failed, also the compared ones.

    A metric without any value, where some trials went well, does not apply to the scenarios. Levels
    have tables and figures of their own (``report.statistics.calibration``).
    """
    some_ok = bool(trials["status"].eq("ok").any())
    return [
        metric
        for metric in metrics
        if metric.name in trials
        and worth_a_table(metric, bool(trials[metric.name].notna().any()), some_ok)
    ]


def worth_a_table(metric: MetricDeclaration, valued: bool, some_ok: bool) -> bool:
    """Whether trials that have a column of a metric show it in tables, as ``in_table`` says.

    Args:
        metric: the metric.
        valued: whether any trial has a value of it.
        some_ok: whether any trial went well.
    """
    return not metric.is_level and (valued or (metric.compared and not some_ok))


def in_leaderboard(
    metrics: Iterable[MetricDeclaration], table: pd.DataFrame
) -> list[MetricDeclaration]:
    """The metrics that a leaderboard summarises, with ``IDENTIFIABLE``, in the order shown."""
    shown = [*metrics, *([] if IDENTIFIABLE in metrics else [IDENTIFIABLE])]
    return [m for m in shown if (f"{m.name}_share" if m.is_share else f"{m.name}_median") in table]
