"""How often regions hold the truth, over the level that they claim."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import PercentFormatter
from scipy.stats import binom

from olne_bench.bench.report.figures import style
from olne_bench.bench.report.figures.series import Series, split
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.statistics.calibration import LEVEL, TARP, coverage_curve
from olne_bench.bench.report.study import USUAL, Study

_BAND = 0.95
_SIZE = 3.6  # of a panel [inch]


def draw(trials: pd.DataFrame, study: Study = USUAL) -> Figure:
    """Coverage against nominal level, one panel per sensor, all noise levels together.

    The grey band holds a calibrated curve of that many trials with 95 % at each level. Dotted lines
    are those of regions around random points (TARP), which need samples.

    Raises:
        NotDrawnError: if no estimate has a region.
    """
    if LEVEL not in trials or not trials[LEVEL].notna().any():
        raise NotDrawnError("no estimate has a region")
    series = [one for one in split(trials, study) if one.trials[LEVEL].notna().any()]
    sensors = list(dict.fromkeys(one.sensor for one in series))
    figure = Figure(figsize=(max(2, len(sensors)) * _SIZE, _SIZE + 0.9))
    panels = figure.subplots(1, len(sensors), sharex=True, sharey=True, squeeze=False)[0]
    for axes, sensor in zip(panels, sensors, strict=True):
        own = [one for one in series if one.sensor == sensor]
        fewest = min(int(one.trials[LEVEL].notna().sum()) for one in own)
        _calibrated(axes, fewest)
        for one in own:
            colour = style.estimator_colours(one.estimator)[0]
            levels = one.trials[LEVEL].dropna().to_numpy(float)
            axes.step(*coverage_curve(levels), where="post", color=colour)
            if _has_tarp(one):
                around = one.trials[TARP].dropna().to_numpy(float)
                axes.step(*coverage_curve(around), where="post", color=colour, linestyle=":")
        axes.set_title(f"{style.printable(sensor)}: {fewest} trials or more")
        axes.set_xlabel("Level of the region")
    for axis in (panels[0].xaxis, panels[0].yaxis):
        axis.set_major_formatter(PercentFormatter(xmax=1, decimals=0))
    panels[0].set(xlim=(0, 1), ylim=(0, 1), ylabel="Trials whose region holds the truth")
    figure.suptitle(f"{trials['scenario'].iloc[0]}: calibration of regions of weights")
    style.legend_below(figure, _entries(series))
    return figure


def _entries(series: list[Series]) -> list[tuple[Line2D, str]]:
    entries = []
    for name in dict.fromkeys(one.estimator for one in series):
        colour = style.estimator_colours(name)[0]
        entries.append((Line2D([], [], color=colour), style.printable(name)))
        if any(_has_tarp(one) for one in series if one.estimator == name):
            line = Line2D([], [], color=colour, linestyle=":")
            entries.append((line, f"{style.printable(name)}, around random points"))
    return entries


def _has_tarp(series: Series) -> bool:
    return TARP in series.trials and bool(series.trials[TARP].notna().any())


def _calibrated(axes: Axes, count: int) -> None:
    levels = np.linspace(0, 1, 201)
    low, high = (binom.ppf(p, count, levels) / count for p in ((1 - _BAND) / 2, (1 + _BAND) / 2))
    axes.fill_between(levels, low, high, color="0.88", linewidth=0)
    axes.plot([0, 1], [0, 1], color="0.5", linewidth=1)
