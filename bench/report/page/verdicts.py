"""Verdicts: which estimator comes first, in a few words."""

import math
from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any

import pandas as pd

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.measures import in_leaderboard, primary
from olne_bench.bench.report.page.numbers import human
from olne_bench.bench.report.statistics.attempts import FLOOR
from olne_bench.bench.report.statistics.estimator_comparison import significant_wins
from olne_bench.bench.report.statistics.standing import ranks_at
from olne_bench.bench.report.study import USUAL, Study


@dataclass(frozen=True)
class Line:
    """The outcome with one sensor.

    Attributes:
        sensor: label of the sensor.
        first: the first estimator of the leaderboard: of those with the best rank the one with the
            least median of the primary metric. Empty if half of its attempts fail.
        error: that median, with its unit.
        remark: how it compares with the next estimator.
        ranked: whether an estimator has a rank; if not, none is first.
        barred: whether that is because of who it is, not of too few trials.
    """

    sensor: str
    first: str
    error: str
    remark: str
    ranked: bool = True
    barred: bool = False


@dataclass(frozen=True)
class Verdict:
    """The outcome of one scenario, sensor by sensor."""

    scenario: str
    lines: list[Line]


def verdicts(table: pd.DataFrame, comparisons: pd.DataFrame, study: Study = USUAL) -> list[Verdict]:
    """The outcome of every scenario of a leaderboard; empty if no metric is compared.

    Args:
        table: a leaderboard.
        comparisons: table of ``bench.report.statistics.estimator_comparison`` for the same trials.
        study: study of the run.
    """
    metric = primary(in_leaderboard(study.metrics, table))
    if metric is None:
        return []
    told = significant_wins(comparisons, metric.name)
    beaten = set(told.itertuples(index=False, name=None))
    return [
        Verdict(
            str(scenario), [_line(group, beaten, metric) for _, group in rows.groupby("sensor")]
        )
        for scenario, rows in table.groupby("scenario")
    ]


def _line(rows: pd.DataFrame, beaten: set[tuple[Any, ...]], metric: MetricDeclaration) -> Line:
    """The outcome with one sensor. The floor is first or next only without other estimators.

    Args:
        rows: rows of one scenario and sensor.
        beaten: scenario, sensor, winner and loser of every significant comparison.
        metric: the primary metric.
    """
    median, rank = f"{metric.name}_median", f"{metric.name}_rank"
    rows = rows.assign(
        floor=rows["estimator"] == FLOOR, unranked=rows[rank].isna(), barred=~ranks_at(rows)
    )
    order = ["floor", "unranked", "barred", rank, median]
    first, *others = rows.sort_values(order).to_dict("records")
    error, sensor, ranked = first[median], str(first["sensor"]), not first["unranked"]
    barred = bool(first["barred"])
    if not math.isfinite(error):
        return Line(sensor, "", "", "", ranked, barred)
    remark = _against(first, others[0], beaten, metric) if others else ""
    return Line(sensor, first["estimator"], _with_unit(error, metric), remark, ranked, barred)


def _against(
    first: dict[Hashable, Any],
    other: dict[Hashable, Any],
    beaten: set[tuple[Any, ...]],
    metric: MetricDeclaration,
) -> str:
    name, theirs = other["estimator"], other[f"{metric.name}_median"]
    error, place = first[f"{metric.name}_median"], (first["scenario"], first["sensor"])
    size = "half of its attempts fail" if math.isinf(theirs) else _with_unit(theirs, metric)
    if other["barred"]:
        return f"{name}: {size}, without a rank ({other['standing']})"
    if first["unranked"]:
        return f"{name}: {size}"
    if other["unranked"] and name != FLOOR:
        return f"{name}: {size}, on a small part of the trials"
    if name == FLOOR and theirs < error:
        return f"{name}: {size}"
    if (*place, first["estimator"], name) not in beaten:
        return f"{name}: {size}, no significant difference"
    if theirs < error:  # medians and most trials can disagree
        return f"{name}: {size}, but worse in most trials"
    factor = theirs / error if error > 0 else math.inf
    times = f"{factor:.2f}" if factor < 1.095 else human(factor)
    return f"{name}: {size}" + (f", {times} times as much" if factor < math.inf else "")


def _with_unit(value: float, metric: MetricDeclaration) -> str:
    return f"{human(value)} {metric.unit}".rstrip()
