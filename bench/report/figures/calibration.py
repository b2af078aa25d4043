"""Whether regions hold the truth as often as they claim, and where true weights lie in them."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.stats import binom

from olne_bench.bench.report.figures import panels, style
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.statistics.attempts import attempts_of
from olne_bench.bench.report.statistics.calibration import (
    LEVEL,
    TARP,
    coverage_curve,
    weight_levels_of,
)
from olne_bench.bench.report.study import USUAL, Study

_BAND = 0.95
_SIZE = 3.5, 3.2  # of a panel [inch]
_MOST_SENSORS = panels.MOST_PANELS // 2
_AT = np.linspace(0, 1, 201)


def draw(trials: pd.DataFrame, _: Study = USUAL) -> Figure:
    """Coverage over the level, and below it levels of single weights, one column per sensor.

    All noise levels count together, and three sensors at most. A grey band holds a calibrated curve
    with 95 % at each level: above, one of that many trials; below, one of as many levels as there
    are draws, as trials of one draw share their true weights. Dotted lines are those of regions
    around random points (TARP), which need samples. Below, a line that rises at both ends belongs
    to intervals that are too narrow; one that is above zero, to estimates that are too high.

    Raises:
        NotDrawnError: if no estimate has a region.
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
        panels.percent(panel.xaxis)
    figure.suptitle(f"{trials['scenario'].iloc[0]}: calibration of regions of weights")
    style.legend_below(figure, _entries(told))
    return figure


def _coverage(axes: Axes, part: pd.DataFrame) -> None:
    _band(axes, int(part.groupby("estimator")[LEVEL].size().min()), less=0.0)
    axes.plot([0, 1], [0, 1], color="0.5", linewidth=1)
    panels.percent(axes.yaxis)
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
    low, high = (binom.ppf(p, count, _AT) / count for p in ((1 - _BAND) / 2, (1 + _BAND) / 2))
    axes.fill_between(_AT, low - less * _AT, high - less * _AT, color="0.88", linewidth=0)


def _entries(told: pd.DataFrame) -> panels.Entries:
    entries: panels.Entries = []
    for name in style.estimator_order(told["estimator"].tolist()):
        colour = style.estimator_colours(name)[0]
        entries.append((Line2D([], [], color=colour), style.printable(name)))
        rows = told[told["estimator"] == name]
        if TARP in rows and rows[TARP].notna().any():
            line = Line2D([], [], color=colour, linestyle=":")
            entries.append((line, f"{style.printable(name)}, around random points"))
    return entries
