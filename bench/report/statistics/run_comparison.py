"""Two runs against each other, on the same observations."""

from collections.abc import Callable, Mapping

import numpy as np
import pandas as pd

from olne_bench.bench.report.statistics.attempts import (
    ERRORS,
    FAILURES,
    attempts_of,
    noisy,
    quantile,
)
from olne_bench.bench.report.statistics.estimator_comparison import (
    SIGNIFICANCE,
    compare_pairs,
    holm,
    paired_errors,
)

_GROUP = ["scenario", "view"]


def changes(before: pd.DataFrame, after: pd.DataFrame, names: Mapping[str, str]) -> pd.DataFrame:
    """What became of the estimators, in every scenario and view that both runs have.

    Trials without noise have nothing random in them and take no part, unless of a family's draws.

    Args:
        before: trials of one run.
        after: trials of another one, or the same.
        names: estimators to compare, label in ``before`` to label in ``after``.

    Returns:
        Columns ``error`` (one of ``ERRORS``, or ``failures``), ``scenario, view, estimator, other,
        pairs``, the medians ``before`` and ``after`` over the pairs (of failures, their shares),
        ``better`` (share of pairs that improved, a tie counting half) with ``better_low`` and
        ``better_high`` (95 %), ``p``, ``p_holm`` and ``verdict``: ``better`` or ``worse`` where
        significant, else ``same``.
    """
    tables = [noisy(attempts_of(trials)) for trials in (before, after)]
    columns = ["error", *_GROUP, "estimator", "other", "pairs", "before", "after"]
    columns += ["better", "better_low", "better_high", "p"]
    rows = []
    for error in (*ERRORS, FAILURES):
        for old, new in names.items():
            first = tables[0][tables[0]["estimator"] == old]
            second = tables[1][tables[1]["estimator"] == new]
            pairs = paired_errors(second, first, error)
            middle = np.mean if error == FAILURES else _median
            for (scenario, view), group in pairs.groupby(_GROUP, sort=True):
                labels = {"error": error, "scenario": scenario, "view": view}
                rows.append(labels | {"estimator": old, "other": new} | _change(group, middle))
    table = pd.DataFrame(rows, columns=columns)
    table["p_holm"] = holm(table["p"].to_numpy(float))
    told = table["p_holm"] < SIGNIFICANCE
    table["verdict"] = np.select(
        [told & (table["better"] > 0.5), told & (table["better"] < 0.5)],
        ["better", "worse"],
        "same",
    )
    return table


def _change(
    pairs: pd.DataFrame, middle: Callable[[np.ndarray], np.floating | float]
) -> dict[str, float]:
    found = compare_pairs(pairs)
    return {
        "pairs": found["pairs"],
        "before": float(middle(pairs["b"].to_numpy())),
        "after": float(middle(pairs["a"].to_numpy())),
        "better": found["wins"],
        "better_low": found["wins_low"],
        "better_high": found["wins_high"],
        "p": found["p"],
    }


def _median(values: np.ndarray) -> float:
    return quantile(values, np.ones(len(values), int), 0.5)
