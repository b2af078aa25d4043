"""Which metrics a table is about, out of what the metrics of its run declare."""

from collections.abc import Iterable, Sequence

import pandas as pd

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration

#: What estimators are ranked by where a run has it; else by the first metric that is compared.
_USUAL_PRIMARY = "position_error"

#: The cosine error less what the data cannot show. It is worked out for a whole run
#: (``statistics.identifiability``), not trial by trial: what can be known at all is a property of
#: a scenario, all its trajectories and a sensor, the same for every estimate.
IDENTIFIABLE = MetricDeclaration(
    "identifiable_cosine_error",
    label="identifiable error",
    worst=1.0,
    gated=True,
    negligible=1e-7,
    description="The cosine error less what the data cannot show at 0.01 m.",
)

#: Compared like an error: 1 for an attempt without a prediction, else 0.
FAILURES = MetricDeclaration("failures", worst=1.0)


def compared(metrics: Iterable[MetricDeclaration]) -> list[MetricDeclaration]:
    """Those that estimators and runs are compared by."""
    return [metric for metric in metrics if metric.compared]


def primary(metrics: Sequence[MetricDeclaration]) -> MetricDeclaration | None:
    """What estimators are ranked by; None where nothing is compared."""
    known = compared(metrics)
    return next((m for m in known if m.name == _USUAL_PRIMARY), known[0] if known else None)


def in_table(metrics: Iterable[MetricDeclaration], trials: pd.DataFrame) -> list[MetricDeclaration]:
    """Those that a table of trials has something of, and those compared that it has a column of."""
    return [
        metric
        for metric in metrics
        if metric.name in trials and (metric.compared or trials[metric.name].notna().any())
    ]


def in_leaderboard(
    metrics: Iterable[MetricDeclaration], table: pd.DataFrame
) -> list[MetricDeclaration]:
    """Those that a leaderboard summarises, ``IDENTIFIABLE`` among them, in the order shown."""
    shown = [*metrics, *([] if IDENTIFIABLE in metrics else [IDENTIFIABLE])]
    return [m for m in shown if (f"{m.name}_share" if m.is_share else f"{m.name}_median") in table]
