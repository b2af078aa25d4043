"""Comparison of two runs on the same observations."""

from collections.abc import Callable, Iterator, Mapping

import numpy as np
import pandas as pd

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.measures import FAILURES, compared, in_table
from olne_bench.bench.report.statistics.attempts import attempts_of, measured, noisy, quantile
from olne_bench.bench.report.statistics.pairs import (
    SIGNIFICANCE,
    compare_pairs,
    holm,
    paired_errors,
)
from olne_bench.bench.report.study import USUAL, Study

_GROUP = ["scenario", "sensor"]


def compare_runs(
    before: pd.DataFrame, after: pd.DataFrame, names: Mapping[str, str], study: Study = USUAL
) -> pd.DataFrame:
    """Compare estimators of two runs in every scenario and sensor that both have.

    Trials without noise are not random and do not count, unless they are of a family's draws.

    Args:
        before: trials of one run.
        after: trials of another run, or the same.
        names: estimators to compare, label in ``before`` to label in ``after``.
        study: study of both runs.

    Returns:
        Columns ``error`` (a metric that is compared, or ``failures``), ``scenario, sensor,
        estimator, other, pairs``, the medians ``before`` and ``after`` over the pairs (of failures,
        their shares), ``ratio`` (geometric mean of error after over error before where neither
        failed), ``better`` (share of pairs that improved, a tie counting half) with
        ``better_low`` and ``better_high`` (95 %), ``p``, ``p_holm`` and ``verdict``: ``better`` or
        ``worse`` if significant, else ``same``.
    """
    columns = ["error", *_GROUP, "estimator", "other", "pairs", "before", "after", "ratio"]
    columns += ["better", "better_low", "better_high", "p"]
    metrics = in_table(in_table(compared(study.metrics), before), after)
    rows = [
        row
        for metric in (*metrics, FAILURES)
        for row in _changes((before, after), names, metric, study)
    ]
    table = pd.DataFrame(rows, columns=columns)
    table["p_holm"] = holm(table["p"].to_numpy(float))
    told = table["p_holm"] < SIGNIFICANCE
    table["verdict"] = np.select(
        [told & (table["better"] > 0.5), told & (table["better"] < 0.5)],
        ["better", "worse"],
        "same",
    )
    return table


def _changes(
    runs: tuple[pd.DataFrame, pd.DataFrame],
    names: Mapping[str, str],
    metric: MetricDeclaration,
    study: Study,
) -> Iterator[dict[str, object]]:
    """Changes of the estimators by one metric, a row per estimator, scenario and sensor."""
    before, after = (noisy(attempts_of(trials), study) for trials in runs)
    before, after = (t[measured(t, metric, study)] for t in (before, after))
    middle = np.mean if metric == FAILURES else _median
    for old, new in names.items():
        first, second = before[before["estimator"] == old], after[after["estimator"] == new]
        pairs = paired_errors(second, first, metric)
        for (scenario, sensor), group in pairs.groupby(_GROUP, sort=True):
            labels = {"error": metric.name, "scenario": scenario, "sensor": sensor}
            change = _change(group, middle, study.is_family(str(scenario)))
            change["ratio"] = _ratio(group, metric)
            yield labels | {"estimator": old, "other": new} | change


def _change(
    pairs: pd.DataFrame, middle: Callable[[np.ndarray], np.floating | float], family: bool
) -> dict[str, float]:
    found = compare_pairs(pairs, family)
    return {
        "pairs": found["pairs"],
        "before": float(middle(pairs["b"].to_numpy())),
        "after": float(middle(pairs["a"].to_numpy())),
        "better": found["wins"],
        "better_low": found["wins_low"],
        "better_high": found["wins_high"],
        "p": found["p"],
    }


def _ratio(pairs: pd.DataFrame, metric: MetricDeclaration) -> float:
    """Geometric mean of the ratio of errors; NaN for failures, and where all failed."""
    both = pairs.loc[np.isfinite(pairs["a"]) & np.isfinite(pairs["b"]), ["a", "b"]]
    if both.empty or metric == FAILURES:
        return float("nan")
    logs = np.log(np.maximum(both, metric.negligible))
    return float(np.exp((logs["a"] - logs["b"]).mean()))


def _median(values: np.ndarray) -> float:
    return quantile(values, np.ones(len(values), int), 0.5)
