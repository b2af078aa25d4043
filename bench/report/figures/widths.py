"""Width of regions against how often they hold the truth: two things that a good one has both."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator, PercentFormatter

from olne_bench.bench.report.figures import style
from olne_bench.bench.report.figures.series import sensors_in
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.statistics.calibration import width_table
from olne_bench.bench.report.study import USUAL, Study

_SIZE = 3.9  # of a panel [inch]
_LEVEL = 0.95
_SMALLEST, _LARGEST = 3.0, 8.0  # markers of the least and the most noise [pt]


def draw(trials: pd.DataFrame, _: Study = USUAL) -> Figure:
    """Coverage of 95 % regions over their median width, one panel per sensor.

    A point is one noise level, the larger the noisier; bars are exact 95 % intervals. An estimator
    is calibrated where its bars reach the line at 95 %, and of those that are, the one on the left
    knows most.

    Raises:
        NotDrawnError: if no estimate has a region with a width.
    """
    table = width_table(trials)
    if table.empty:
        raise NotDrawnError("no estimate has a region with a width")
    sensors = sensors_in(table)
    sigmas = sorted(table["sigma"].unique())
    sizes = dict(zip(sigmas, np.linspace(_SMALLEST, _LARGEST, len(sigmas)), strict=True))
    estimators = style.estimator_order(list(table["estimator"]))
    figure = Figure(figsize=(max(2, len(sensors)) * _SIZE, _SIZE))
    panels = figure.subplots(1, len(sensors), sharex=True, sharey=True, squeeze=False)[0]
    for axes, sensor in zip(panels, sensors, strict=True):
        axes.axhline(_LEVEL, color="0.5", linewidth=1, linestyle="--")
        for name in estimators:
            own = table[(table["sensor"] == sensor) & (table["estimator"] == name)]
            _points(axes, own, name, sizes)
        axes.set_title(style.printable(sensor))
        axes.set_xlabel("Width of the region (standard deviation)")
    panels[0].set_xscale("log")
    panels[0].xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    panels[0].xaxis.set_minor_locator(NullLocator())
    panels[0].xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    panels[0].set(ylim=(-0.02, 1.02), ylabel="Share of 95 % regions that hold the truth")
    panels[0].yaxis.set_major_formatter(PercentFormatter(xmax=1, decimals=0))
    levels = ", ".join(f"{sigma:g}" for sigma in sigmas)
    scenario = trials["scenario"].iloc[0]
    figure.suptitle(f"{scenario}: width against coverage at σ = {levels} m (small to large)")
    style.legend_below(figure, [(_handle(name), style.printable(name)) for name in estimators])
    return figure


def _points(axes: Axes, own: pd.DataFrame, name: str, sizes: dict[float, float]) -> None:
    """The points of one estimator, with bars, joined in the order of the noise."""
    colour, marker = style.estimator_colours(name)[0], style.estimator_marker(name)
    own = own.sort_values("sigma")
    axes.plot(own["width"], own["covered"], color=colour, linewidth=0.8, alpha=0.5)
    for row in own.to_dict("records"):
        bars = [[row["covered"] - row["covered_low"]], [row["covered_high"] - row["covered"]]]
        axes.errorbar(
            row["width"],
            row["covered"],
            yerr=bars,
            color=colour,
            marker=marker,
            markersize=sizes[row["sigma"]],
            elinewidth=0.9,
        )


def _handle(name: str) -> Line2D:
    colour, marker = style.estimator_colours(name)[0], style.estimator_marker(name)
    return Line2D([], [], color=colour, marker=marker, markersize=5, linewidth=0.8)
