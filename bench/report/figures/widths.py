"""Width of regions against how often they hold the truth: two things that a good one has both."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from olne_bench.bench.report.figures import panels, style
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.statistics.calibration import width_table
from olne_bench.bench.report.study import USUAL, Study

_SIZE = 3.5, 3.1  # of a panel [inch]
_LEVEL = 0.95
_NARROW = 1.5  # ratio of the ends of an axis below which it is widened
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
    sensors = style.sensor_order(table["sensor"].tolist())
    sigmas = sorted(table["sigma"].unique())
    sizes = dict(zip(sigmas, np.linspace(_SMALLEST, _LARGEST, len(sigmas)), strict=True))
    names = style.estimator_order(table["estimator"].tolist())
    figure, axes = panels.grid(sensors, _SIZE)
    for panel, sensor in zip(axes, sensors, strict=False):
        _frame(panel)
        for name in names:
            own = table[(table["sensor"] == sensor) & (table["estimator"] == name)]
            _points(panel, own.sort_values("sigma"), name, sizes)
        low, high = panel.get_xlim()
        if high < _NARROW * low:  # one width, or two that differ by rounding
            panel.set_xlim(low / _NARROW, high * _NARROW)
    scenario = trials["scenario"].iloc[0]
    levels = f"{sigmas[0]:g} to {sigmas[-1]:g} m" if len(sigmas) > 1 else f"{sigmas[0]:g} m"
    figure.suptitle(f"{scenario}: width against coverage, σ = {levels} (small to large)")
    style.legend_below(figure, panels.estimator_entries(names))
    return figure


def _frame(axes: Axes) -> None:
    axes.axhline(_LEVEL, color="0.5", linewidth=1, linestyle="--")
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axes.set(ylim=(-0.02, 1.02), ylabel="95 % regions that hold the truth")
    axes.set_xlabel("Width of the region (standard deviation)")
    panels.percent(axes.yaxis)


def _points(axes: Axes, own: pd.DataFrame, name: str, sizes: dict[float, float]) -> None:
    """The points of one estimator, with bars, joined in the order of the noise."""
    looks = panels.estimator_looks(name)
    axes.plot(own["width"], own["covered"], color=looks["color"], linewidth=0.8, alpha=0.5)
    for row in own.to_dict("records"):
        bars = [[row["covered"] - row["covered_low"]], [row["covered_high"] - row["covered"]]]
        size = looks | {"markersize": sizes[row["sigma"]], "elinewidth": 0.9}
        axes.errorbar(row["width"], row["covered"], yerr=bars, **size)
