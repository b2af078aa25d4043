"""The page of a study of streams: errors over time, predictions, latencies."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from olne_bench.bench.plan.kinds import REFERENCES, STOCK_FITTED
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.report.figures import style
from olne_bench.bench.report.page.template import csv_texts, repeats, script, table_rows, template
from olne_bench.bench.report.statistics.estimator_comparison import SIGNIFICANCE
from olne_bench.bench.run.provenance import Provenance

#: Errors that the page draws over time, and how they are called.
_DRAWN = {
    "cosine_error": "Cosine error of the weights",
    "fde_1s": "Position error 1 s ahead [m]",
    "fde_3s": "Position error 3 s ahead [m]",
}
_GREY = "#7a7a7a"
_LINES = ("2 3", "7 3", "9 2 2 2", "1 4 6 4", "10 3 2 3", "5 2")
_REFERENCES = REFERENCES["streams"]
_DASHES = dict(zip(_REFERENCES, _LINES, strict=True))
_WIDTH, _HEIGHT = 460, 250  # of a chart, in its own units
_LEFT, _RIGHT, _TOP, _BOTTOM = 44, 8, 10, 34
_CROSS = 4  # half the size of a point that stands alone
_LEAST = 1e-6  # smaller errors are drawn as this one


@dataclass(frozen=True)
class OnlineTables:
    """Tables of ``bench.report.stream_tables``."""

    summary: pd.DataFrame
    over_time: pd.DataFrame
    comparisons: pd.DataFrame

    def by_name(self) -> dict[str, pd.DataFrame]:
        """The tables by the names of their files."""
        return {
            "summary": self.summary,
            "over_time": self.over_time,
            "comparisons": self.comparisons,
        }


@dataclass(frozen=True)
class Line:
    """A line of a chart, and the band of its interval; texts of SVG paths."""

    name: str
    path: str
    band: str
    colour: str
    dash: str


@dataclass(frozen=True)
class Chart:
    """A chart with a logarithmic scale.

    Attributes:
        title: what it shows.
        lines: its lines.
        xs: labels of the horizontal axis with their places.
        ys: the same of the vertical axis.
    """

    title: str
    lines: tuple[Line, ...]
    xs: tuple[tuple[float, str], ...]
    ys: tuple[tuple[float, str], ...]


def online_page(tables: OnlineTables, runs: Sequence[Provenance], suite: Suite) -> str:
    """The page as HTML.

    Args:
        tables: tables of the study.
        runs: provenance of the rows, the latest run last.
        suite: suite of that run.
    """
    names = list(dict.fromkeys(tables.summary["estimator"]))
    return template("streams.html").render(
        title=f"{suite.name}, one sample at a time",
        description=suite.description,
        summary=table_rows(tables.summary),
        comparisons=table_rows(tables.comparisons),
        charts=_charts(tables.over_time),
        looks={name: _look(name) for name in names},
        references=_REFERENCES,
        fitted=STOCK_FITTED,
        rules=suite.rules,
        motions=int(tables.summary.groupby(["scenario", "sensor", "sigma"])["motions"].max().sum()),
        updates=int(tables.summary["updates"].sum()),
        command=repeats(runs[-1], suite),
        runs=list(runs),
        significance=SIGNIFICANCE,
        box={"w": _WIDTH, "h": _HEIGHT, "l": _LEFT, "r": _RIGHT, "t": _TOP, "b": _BOTTOM},
        data={"tables": csv_texts(tables.by_name())},
        script=script(("look", "save", "online")),
    )


def _look(name: str) -> tuple[str, str]:
    """Colour and dashes of a line."""
    if name in _REFERENCES:
        return _GREY, _DASHES[name]
    return style.estimator_colours(name)[0], ""


def _charts(over_time: pd.DataFrame) -> list[tuple[str, list[Chart]]]:
    """Charts of each scenario, sensor and noise level, under their titles."""
    found = []
    for (scenario, sensor, sigma), part in over_time.groupby(
        ["scenario", "sensor", "sigma"], sort=False
    ):
        charts = [
            _chart(part, column, title) for column, title in _DRAWN.items() if part[column].any()
        ]
        found.append((f"{scenario}, {sensor}, noise {sigma:g}", charts))
    return found


def _chart(part: pd.DataFrame, column: str, title: str) -> Chart:
    ends = [column, f"{column}_low", f"{column}_high"]
    told = part[[*ends, "time"]].to_numpy(float)[:, :3]
    values = [max(v, _LEAST) for v in told.ravel().tolist() if math.isfinite(v) and v > 0]
    lowest, highest = math.log10(min(values, default=0.1)), math.log10(max(values, default=1.0))
    span, last = max(highest - lowest, 0.1), max(float(part["time"].max()), 1e-9)

    def x(time: float) -> float:
        return round(_LEFT + (_WIDTH - _LEFT - _RIGHT) * time / last, 1)

    def y(value: float) -> float:
        share = (math.log10(max(value, _LEAST)) - lowest) / span
        return round(_HEIGHT - _BOTTOM - (_HEIGHT - _TOP - _BOTTOM) * min(max(share, 0), 1), 1)

    lines = []
    for name, own in part.groupby("estimator", sort=False):
        rows = own[["time", *ends]].to_numpy(float)
        middle = [(x(row[0]), y(row[1])) for row in rows if math.isfinite(row[1])]
        sure = [row for row in rows if np.isfinite(row).all()] if name not in _REFERENCES else []
        band = [(x(row[0]), y(row[3])) for row in sure]
        band += [(x(row[0]), y(row[2])) for row in sure[::-1]]
        if middle:
            look = _look(str(name))
            lines.append(Line(str(name), _path(middle), _path(band, close=True), *look))
    return Chart(
        title,
        tuple(lines),
        tuple((x(second), f"{second:g}") for second in range(int(last) + 1)),
        tuple((y(value), f"{value:g}") for value in _round_numbers(lowest, lowest + span)),
    )


def _round_numbers(low: float, high: float) -> list[float]:
    """Numbers for an axis from 10**low to 10**high."""
    decades = range(math.floor(low), math.ceil(high) + 1)
    within = [
        step * 10.0**power
        for power in decades
        for step in ((1, 2, 5) if high - low < 2.5 else (1,))
    ]
    return [value for value in within if low <= math.log10(value) <= high]


def _path(points: Sequence[tuple[float, float]], close: bool = False) -> str:
    if not points:
        return ""
    if len(points) == 1:  # a cross, as nothing can be joined
        ((px, py),) = points
        return f"M{px - _CROSS:g} {py:g}h{2 * _CROSS:g}M{px:g} {py - _CROSS:g}v{2 * _CROSS:g}"
    return "M" + "L".join(f"{px:g} {py:g}" for px, py in points) + ("Z" if close else "")
