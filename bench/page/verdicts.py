"""Who comes first, in a few words."""

import math
from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any

import pandas as pd

from bench.page.numbers import human
from bench.statistics.attempts import FLOOR


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


def verdicts(table: pd.DataFrame) -> list[Verdict]:
    """The outcome of every scenario of a leaderboard."""
    return [
        Verdict(str(scenario), [_line(str(view), group) for view, group in rows.groupby("view")])
        for scenario, rows in table.groupby("scenario")
    ]


def _line(view: str, rows: pd.DataFrame) -> Line:
    """The floor is first, or next, where there is nobody else."""
    rows = rows.assign(floor=rows["estimator"] == FLOOR)
    first, *others = rows.sort_values(["floor", "position_error_median"]).to_dict("records")
    error = first["position_error_median"]
    if math.isinf(error):
        return Line(view, "", error, "")
    return Line(view, first["estimator"], error, _against(error, others[0]) if others else "")


def _against(error: float, other: dict[Hashable, Any]) -> str:
    name, theirs = other["estimator"], other["position_error_median"]
    size = "half of its attempts fail" if math.isinf(theirs) else f"{human(theirs)} m"
    if theirs < error:
        return f"{name}: {size}"
    if other["position_error_rank"] == 1:
        return f"{name}: {size}, no significant difference"
    factor = theirs / error if error > 0 else math.inf
    return f"{name}: {size}" + (f", {human(factor)} times as much" if factor < math.inf else "")
