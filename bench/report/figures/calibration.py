"""Whether regions hold the truth as often as they claim, where in them it lies, and their width."""

import numpy as np
import pandas as pd
import scipy
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullLocator

from olne_bench.bench.report.figures import style
from olne_bench.bench.report.formats import NotDrawnError
from olne_bench.bench.report.statistics.attempts import attempts_of
from olne_bench.bench.report.statistics.calibration import (
    LEVEL,
    TARP,
    coverage_curve,
    weight_levels_of,
    width_table,
)

_LEVEL = 0.95  # of the band of calibrated curves, and of regions that have a width
_SIZE, _WIDTH_SIZE = (3.5, 3.2), (3.5, 3.1)  # of a panel [inch]
_MOST_SENSORS = style.MOST_PANELS // 2
_AT = np.linspace(0, 1, 201)
_NARROW = 1.5  # ratio of the ends of an axis of widths below which it is widened
_SMALLEST, _LARGEST = 3.0, 8.0  # markers of the least and the most noise [pt]


def draw_coverage(trials: pd.DataFrame) -> Figure:
    """Coverage over the level, and below it levels of single weights, a column per sensor.

    All noise levels count, and three sensors at most. A grey band holds a calibrated curve with
    95 % at each level: above, one of that many trials; below, of as many levels as there are draws,
    as trials of a draw share their weights. Dotted lines are of regions around random points
    (TARP). Below, lines that rise at both ends belong to intervals that are too narrow; those above
    zero, to estimates that are too high.
    """
    attempts = attempts_of(trials)
    if LEVEL not in attempts or not attempts[LEVEL].notna().any():
        raise NotDrawnError("no estimate has a region")
    told = attempts[attempts[LEVEL].notna()]
    sensors = style.sensor_order(told["sensor"].tolist())[:_MOST_SENSORS]
    parts = [told[told["sensor"] == sensor] for sensor in sensors]
    weights = any(weight_levels_of(part).size for part in parts)
    figure = Figure(figsize=(max(4.8, _SIZE[0] * len(parts)), _SIZE[1] * (1 + weights) + 0.5))
    axes = figure.subplots(1 + weights, len(parts), squeeze=False, sharex=True)
    for column, part, sensor in zip(axes.T, parts, sensors, strict=True):
        _coverage(column[0], part)
        column[0].set(title=style.printable(sensor), xlim=(0, 1), ylim=(0, 1))
        if weights:
            _levels(column[1], part)
    axes[0][0].set_ylabel("Regions that hold the truth")
    for panel in axes[-1]:
        panel.set_xlabel("Level of the true weight" if weights else "Level of the region")
        style.percent(panel.xaxis)
    style.entitle(figure, f"{trials['scenario'].iloc[0]}: calibration of regions of weights")
    style.legend_below(figure, _entries(told))
    return figure


def _coverage(axes: Axes, part: pd.DataFrame) -> None:
    _band(axes, int(part.groupby("estimator")[LEVEL].size().min()), less=0.0)
    axes.plot([0, 1], [0, 1], color="0.5", linewidth=1)
    style.percent(axes.yaxis)
    for name, rows in part.groupby("estimator"):
        colour = style.estimator_colours(str(name))[0]
        axes.step(*coverage_curve(rows[LEVEL].to_numpy(float)), where="post", color=colour)
        if TARP in rows and rows[TARP].notna().any():
            around = rows[TARP].dropna().to_numpy(float)
            axes.step(*coverage_curve(around), where="post", color=colour, linestyle=":")


def _levels(axes: Axes, part: pd.DataFrame) -> None:
    """Cumulative share of the levels of single weights less the level, a line per weight."""
    _band(axes, part["seed"].nunique(), less=1.0)
    axes.axhline(0, color="0.5", linewidth=1)
    axes.set_ylabel("Levels of weights below, less the level")
    for name, rows in part.groupby("estimator"):
        levels = weight_levels_of(rows)
        colour = style.estimator_colours(str(name))[0]
        for own in levels.reshape(len(levels), -1).T if levels.size else ():
            level, share = coverage_curve(own[np.isfinite(own)])
            axes.plot(level, share - level, color=colour, linewidth=0.8, alpha=0.6)


def _band(axes: Axes, count: int, less: float) -> None:
    low, high = (
        scipy.stats.binom.ppf(p, count, _AT) / count for p in ((1 - _LEVEL) / 2, (1 + _LEVEL) / 2)
    )
    axes.fill_between(_AT, low - less * _AT, high - less * _AT, color="0.88", linewidth=0)


def _entries(told: pd.DataFrame) -> style.Entries:
    entries: list[tuple[Artist, str]] = []
    for name in style.estimator_order(told["estimator"].tolist()):
        colour = style.estimator_colours(name)[0]
        entries.append((Line2D([], [], color=colour), style.printable(name)))
        rows = told[told["estimator"] == name]
        if TARP in rows and rows[TARP].notna().any():
            line = Line2D([], [], color=colour, linestyle=":")
            entries.append((line, f"{style.printable(name)}, around random points"))
    return entries


def draw_widths(trials: pd.DataFrame) -> Figure:
    """Coverage of 95 % regions over their median width, one panel per sensor.

    A point is one noise level, the larger the noisier; bars are exact 95 % intervals. Of estimators
    whose bars reach the line at 95 %, the one on the left knows most.
    """
    table = width_table(trials)
    if table.empty:
        raise NotDrawnError("no estimate has a region with a width")
    sigmas = sorted(table["sigma"].unique())
    sizes = dict(zip(sigmas, np.linspace(_SMALLEST, _LARGEST, len(sigmas)), strict=True))
    names = style.estimator_order(table["estimator"].tolist())
    figure, panels = style.by_sensor(table, _WIDTH_SIZE)
    for panel, own in panels:
        _frame(panel)
        for name in names:
            _points(panel, own[own["estimator"] == name].sort_values("sigma"), name, sizes)
        low, high = panel.get_xlim()
        if high < _NARROW * low:  # one width, or two that differ by rounding
            panel.set_xlim(low / _NARROW, high * _NARROW)
    scenario = trials["scenario"].iloc[0]
    levels = f"{sigmas[0]:g} to {sigmas[-1]:g} m" if len(sigmas) > 1 else f"{sigmas[0]:g} m"
    style.entitle(figure, f"{scenario}: width against coverage, σ = {levels} (small to large)")
    style.legend_below(figure, style.estimator_entries(names))
    return figure


def _frame(axes: Axes) -> None:
    axes.axhline(_LEVEL, color="0.5", linewidth=1, linestyle="--")
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(style.plain)
    axes.set(ylim=(-0.02, 1.02), ylabel="95 % regions that hold the truth")
    axes.set_xlabel("Width of the region (standard deviation)")
    style.percent(axes.yaxis)


def _points(axes: Axes, own: pd.DataFrame, name: str, sizes: dict[float, float]) -> None:
    """The points of one estimator, with bars, joined in the order of the noise."""
    looks = style.estimator_looks(name)
    axes.plot(own["width"], own["covered"], color=looks["color"], linewidth=0.8, alpha=0.5)
    for row in own.to_dict("records"):
        bars = [[row["covered"] - row["covered_low"]], [row["covered_high"] - row["covered"]]]
        size = looks | {"markersize": sizes[row["sigma"]], "elinewidth": 0.9}
        axes.errorbar(row["width"], row["covered"], yerr=bars, **size)
