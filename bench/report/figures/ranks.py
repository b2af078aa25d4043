"""Where true weights lie in what estimates say about them: simulation-based calibration."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.stats import binom

from olne_bench.bench.report.figures import style
from olne_bench.bench.report.figures.series import Series, split
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.statistics.calibration import WEIGHTS, coverage_curve, weight_levels_of
from olne_bench.bench.report.study import USUAL, Study

_BAND = 0.95
_SIZE = 3.4, 2.0  # of a panel [inch]


def draw(trials: pd.DataFrame, study: Study = USUAL) -> Figure:
    """Cumulative share of levels less the level, a row per estimator and a column per sensor.

    A line is one weight, at all noise levels together. If an estimate is calibrated, a line stays
    in the grey band with at least 95 % at each level. The band is that of as many independent
    levels as there are seeds, of the weight in the fewest: trials of one seed share their true
    weights at all noise levels, so they may say little more than one of them does. A line that
    rises at both ends belongs to intervals that are too narrow; one that is above zero
    throughout, to estimates that are too high.

    Raises:
        NotDrawnError: if no estimate tells the levels of single weights.
    """
    series = [one for one in split(trials, study) if weight_levels_of(one.trials).size]
    if not series:
        raise NotDrawnError("no estimate says where single weights are")
    sensors = list(dict.fromkeys(one.sensor for one in series))
    estimators = style.estimator_order([one.estimator for one in series])
    size = max(1.6, len(sensors)) * _SIZE[0], len(estimators) * _SIZE[1] + 1.0
    figure = Figure(figsize=size)
    shape = len(estimators), len(sensors)
    panels = figure.subplots(*shape, sharex=True, sharey=True, squeeze=False)
    for one in series:
        _panel(panels[estimators.index(one.estimator)][sensors.index(one.sensor)], one)
    for axes, sensor in zip(panels[0], sensors, strict=True):
        axes.set_title(style.printable(sensor))
    for axes, estimator in zip(panels[:, 0], estimators, strict=True):
        axes.set_ylabel(style.printable(estimator))
    for axes in panels[-1]:
        axes.set_xlabel("Level of the true weight")
    panels[0][0].set(xlim=(0, 1))
    figure.suptitle(f"{trials['scenario'].iloc[0]}: share of levels below, less the level")
    players = max(weight_levels_of(one.trials).shape[1] for one in series)
    entries = [
        (Line2D([], [], color=f"C{i}"), f"weights of player {i + 1}") for i in range(players)
    ]
    style.legend_below(figure, entries)
    return figure


def _panel(axes: Axes, series: Series) -> None:
    levels = weight_levels_of(series.trials)
    seeds = series.trials.dropna(subset=[WEIGHTS])["seed"].to_numpy()
    told = [np.unique(seeds[has]).size for has in np.isfinite(levels[:, :, 0]).T]
    count = min(told)
    at = np.linspace(0, 1, 201)
    low, high = (binom.ppf(p, count, at) / count - at for p in ((1 - _BAND) / 2, (1 + _BAND) / 2))
    axes.fill_between(at, low, high, color="0.88", linewidth=0)
    axes.axhline(0, color="0.5", linewidth=1)
    for player, own in enumerate(np.moveaxis(levels, 0, -1)):
        for weight in own:
            level, share = coverage_curve(weight[np.isfinite(weight)])
            axes.plot(level, share - level, color=f"C{player}", linewidth=0.9, alpha=0.8)
    seeds_told = f"{count} seeds" + (" or more" if count < max(told) else "")
    axes.text(0.02, 0.04, seeds_told, transform=axes.transAxes, fontsize="small")
