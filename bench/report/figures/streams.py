"""Errors and latencies of estimates while a motion goes on."""

from collections.abc import Iterator
from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, NullFormatter

from olne_bench.bench.plan.kinds import REFERENCES
from olne_bench.bench.report.figures import panels, style
from olne_bench.bench.report.statistics.attempts import attempts_of

#: Columns of the panels, and how they are called.
_MEASURES = {
    "cosine_error": "Cosine error",
    "fde_1s": "Position error 1 s ahead [m]",
    "fde_3s": "Position error 3 s ahead [m]",
    "latency": "Latency [s]",
}
_REFERENCES = REFERENCES["streams"]
_SPARSE, _LONG = (0, (1, 3)), (0, (8, 2))
_REFERENCE_STYLES = {
    name: {"color": "#555555", "linestyle": line, "linewidth": 1.1}
    for name, line in zip(_REFERENCES, (*style.LINE_STYLES[::-1], _SPARSE, _LONG), strict=True)
}
_SIZE = 4.2, 2.5  # of a panel [inch]
_QUARTILES = (0.25, 0.5, 0.75)


def figures_of(rows: pd.DataFrame) -> Iterator[tuple[str, Figure]]:
    """Names and figures of a study, one for each scenario, sensor and noise level.

    Args:
        rows: rows of updates, as ``report.stream_tables.update_table`` makes them.
    """
    judged = attempts_of(rows)
    for (scenario, sensor), part in judged.groupby(["scenario", "sensor"], sort=False):
        levels = part.groupby("sigma")
        for sigma, own in levels:
            name = f"online_{scenario}_{sensor}" + f"_{sigma:g}" * (len(levels) > 1)
            yield name, figure_of(f"{scenario}, {sensor}, σ = {sigma:g} m", own)


def figure_of(title: str, rows: pd.DataFrame) -> Figure:
    """Medians over motions and their quartiles over the time since the start, a panel a measure.

    Samples before the first estimate have no errors.
    """
    shown = [name for name in _MEASURES if rows[name].notna().any()]
    figure, axes = panels.grid([_MEASURES[name] for name in shown], _SIZE)
    estimators = [n for n in rows["estimator"].unique() if n not in _REFERENCES]
    references = [n for n in _REFERENCES if n in set(rows["estimator"])]
    names = [*references, *style.estimator_order(estimators)]
    for panel, measure in zip(axes, shown, strict=True):
        for name in names:
            _draw(panel, rows[rows["estimator"] == name], measure, name)
        panel.set_yscale("log")
        panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        panel.yaxis.set_minor_formatter(NullFormatter())
        panel.set_xlabel("Time since the first sample [s]")
    motions = rows["seed"].nunique()
    figure.suptitle(
        f"{style.printable(title)}: estimates after each sample\n"
        f"(median and quartiles of {motions} motion{'s' if motions != 1 else ''})"
    )
    entries = [(Line2D([], [], **_looks(name)), style.printable(name)) for name in names]
    style.legend_below(figure, entries)
    return figure


def _looks(name: str) -> dict[str, Any]:
    return _REFERENCE_STYLES.get(name) or {"color": style.estimator_colours(name)[0]}


def _draw(axes: Axes, rows: pd.DataFrame, measure: str, name: str) -> None:
    """Median over motions at each time, and quartiles of estimators."""
    by_time = rows[rows[measure].notna()].groupby("time")[measure]
    low, middle, high = (by_time.quantile(share) for share in _QUARTILES)
    times, looks = middle.index.to_numpy(float), _looks(name)
    axes.plot(times, middle, **looks)
    if name not in _REFERENCES:
        axes.fill_between(times, low, high, alpha=0.15, linewidth=0, color=looks["color"])
