"""Who comes first, in a few words."""

import math
from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any

import pandas as pd

from olne_bench.bench.report.page.numbers import human
from olne_bench.bench.report.statistics.attempts import FLOOR
from olne_bench.bench.report.statistics.estimator_comparison import significant


@dataclass(frozen=True)
class Line:
    """The outcome in one view.

    Attributes:
        view: its name.
        first: the estimator with the least median position error; empty where half of the
            attempts of each have no prediction.
        error: that error [m].
        remark: how it compares with the next one.
    """

    view: str
    first: str
    error: float
    remark: str


@dataclass(frozen=True)
class Verdict:
    """The outcome of one scenario, view by view."""

    scenario: str
    lines: list[Line]


def verdicts(table: pd.DataFrame, comparisons: pd.DataFrame) -> list[Verdict]:
    """The outcome of every scenario of a leaderboard.

    Args:
        table: a leaderboard.
        comparisons: of the same trials, from ``bench.report.statistics.estimator_comparison``.
    """
    beaten = set(significant(comparisons, "position_error").itertuples(index=False, name=None))
    return [
        Verdict(str(scenario), [_line(group, beaten) for _, group in rows.groupby("view")])
        for scenario, rows in table.groupby("scenario")
    ]


def _line(rows: pd.DataFrame, beaten: set[tuple[Any, ...]]) -> Line:
    """The floor is first, or next, where there is nobody else.

    Args:
        rows: of one scenario and view.
        beaten: scenario, view, winner and loser of every significant comparison.
    """
    rows = rows.assign(floor=rows["estimator"] == FLOOR)
    first, *others = rows.sort_values(["floor", "position_error_median"]).to_dict("records")
    error, view = first["position_error_median"], str(first["view"])
    if math.isinf(error):
        return Line(view, "", error, "")
    return Line(
        view, first["estimator"], error, _against(first, others[0], beaten) if others else ""
    )


def _against(
    first: dict[Hashable, Any], other: dict[Hashable, Any], beaten: set[tuple[Any, ...]]
) -> str:
    name, theirs = other["estimator"], other["position_error_median"]
    error, place = first["position_error_median"], (first["scenario"], first["view"])
    size = "half of its attempts fail" if math.isinf(theirs) else f"{human(theirs)} m"
    if theirs < error:
        return f"{name}: {size}"
    if (*place, name, first["estimator"]) in beaten:  # medians and most trials can disagree
        return f"{name}: {size}, but better in most trials"
    if (*place, first["estimator"], name) not in beaten:
        return f"{name}: {size}, no significant difference"
    factor = theirs / error if error > 0 else math.inf
    return f"{name}: {size}" + (f", {human(factor)} times as much" if factor < math.inf else "")
