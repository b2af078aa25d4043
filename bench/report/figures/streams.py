"""Errors and latencies of estimates while a motion goes on."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, NullFormatter

from olne_bench.bench.plan.kinds import REFERENCES
from olne_bench.bench.report.figures import style
from olne_bench.bench.report.formats import USUAL_FORMATS
from olne_bench.bench.report.statistics.attempts import attempts_of

#: Columns of a row of panels, and how they are called.
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
_WIDTH, _HEIGHT = 3.4, 2.2  # of a panel [inch]
_QUARTILES = (0.25, 0.5, 0.75)


def draw_online(
    rows: pd.DataFrame, directory: Path, formats: Sequence[str] = USUAL_FORMATS
) -> list[Path]:
    """Draw ``online_<scenario>_<sensor>`` of each scenario and sensor; the files written.

    Args:
        rows: rows of updates, as ``report.online.update_table`` makes them.
        directory: folder for the files.
        formats: some of ``FORMATS``.
    """
    judged = attempts_of(rows)
    files = []
    with style.applied():
        for (scenario, sensor), part in judged.groupby(["scenario", "sensor"], sort=False):
            stem = directory / style.file_name(f"online_{scenario}_{sensor}")
            files += style.save(figure_of(f"{scenario}, {sensor}", part), stem, formats)
    return files


def figure_of(title: str, rows: pd.DataFrame) -> Figure:
    """Medians over the time since the start, with quartiles; a column for each noise level.

    Samples before the first estimate have no errors.
    """
    sigmas = sorted(rows["sigma"].unique())
    shown = [name for name in _MEASURES if rows[name].notna().any()]
    figure = Figure(figsize=(max(2, len(sigmas)) * _WIDTH, len(shown) * _HEIGHT))
    panels = figure.subplots(len(shown), len(sigmas), squeeze=False, sharex=True, sharey="row")
    estimators = [n for n in rows["estimator"].unique() if n not in _REFERENCES]
    references = [n for n in _REFERENCES if n in set(rows["estimator"])]
    names = [*references, *style.estimator_order(estimators)]
    for line, measure in zip(panels, shown, strict=True):
        for axes, sigma in zip(line, sigmas, strict=True):
            for name in names:
                own = rows[(rows["estimator"] == name) & (rows["sigma"] == sigma)]
                _draw(axes, own, measure, name)
            axes.set_yscale("log")
            axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axes.yaxis.set_minor_formatter(NullFormatter())
        line[0].set_ylabel(_MEASURES[measure])
    for axes, sigma in zip(panels[0], sigmas, strict=True):
        axes.set_title(f"σ = {sigma:g} m")
    for axes in panels[-1]:
        axes.set_xlabel("Time since the first sample [s]")
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
