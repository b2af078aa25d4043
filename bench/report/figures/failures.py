"""How often estimators fail, over the noise level."""

from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import PercentFormatter

from olne_bench.bench.report.figures import style
from olne_bench.bench.report.figures.levels import has_curve
from olne_bench.bench.report.figures.series import Series, split
from olne_bench.bench.report.leaderboard import published_failures
from olne_bench.bench.report.study import USUAL, Study

_SPREAD = 0.27  # of the distance between two noise levels


def draw(trials: pd.DataFrame, study: Study = USUAL) -> Figure:
    """Share of failures by the published definition, with 95 % Wilson intervals.

    The legend gives the number of trials without any prediction.

    Raises:
        NotDrawnError: if there are no attempts.
    """
    series = split(trials, study)
    figure = Figure(figsize=(8.4, 4.1))
    axes = figure.subplots()
    levels = sorted(pd.concat([s.trials["sigma"] for s in series]).unique())
    shares = [failure_shares(s) for s in series]
    line = partial(_line, joined=has_curve(series))
    for s, share, offset in zip(series, shares, _offsets(len(series)), strict=True):
        places = [levels.index(sigma) + offset for sigma in share["sigma"]]
        axes.plot(places, share["share"], **line(s))
        if not s.is_floor:
            _intervals(axes, s, share, places)
    # Levels are spaced evenly, as half of them lie in the lowest tenth of the range.
    axes.set_xticks(range(len(levels)), [f"{sigma:g}" for sigma in levels], rotation=60)
    axes.yaxis.set_major_formatter(PercentFormatter(xmax=1, decimals=0))
    highest = max(0.05, *(share["high"].max() for share in shares))
    axes.set_ylim(-0.02 * highest, min(1.05 * highest, 1.02))
    axes.set_xlabel("Noise level σ: standard deviation of positions [m]")
    axes.set_ylabel("Failed trials, published definition")
    axes.set_title(f"{trials['scenario'].iloc[0]}: failures (95 % Wilson intervals)")
    style.legend_below(figure, [_entry(s, line(s)) for s in series])
    return figure


def _offsets(count: int) -> np.ndarray:
    """Horizontal shifts that keep the intervals of a level apart."""
    return np.linspace(-_SPREAD, _SPREAD, count) if count > 1 else np.zeros(1)


def failure_shares(series: Series) -> pd.DataFrame:
    """Per noise level: ``share`` of failed trials and its interval ``low, high``.

    Rows that stand for several equal sequences (sigma = 0) are not random and have no interval: low
    and high are the share itself.
    """
    levels = []
    for sigma, rows in series.trials.groupby("sigma"):
        weights = rows["count"].to_numpy(int)
        failed = published_failures(rows)
        share = low = high = weights[failed].sum() / weights.sum()
        if (weights == 1).all():
            from scipy.stats import binomtest  # slow to import

            interval = binomtest(int(failed.sum()), len(rows)).proportion_ci(method="wilson")
            low, high = interval.low, interval.high
        levels.append({"sigma": sigma, "share": share, "low": low, "high": high})
    return pd.DataFrame(levels)


def _intervals(axes: Axes, series: Series, shares: pd.DataFrame, places: list[float]) -> None:
    axes.vlines(
        places, shares["low"], shares["high"], color=series.colour, alpha=0.5, linewidth=1.2
    )


def _line(series: Series, joined: bool) -> dict[str, Any]:
    """Style of a series: points, joined by a line if there are many levels; the floor is a line."""
    line = {"color": series.colour, "linestyle": series.line_style if joined else "none"}
    if series.is_floor:
        return line | {"linewidth": 0.8, "linestyle": "-"}
    return line | {"linewidth": 1.1, "marker": series.marker, "markersize": 3.5}


def _entry(series: Series, line: dict[str, Any]) -> tuple[Artist, str]:
    count = series.count
    failed, without = count[series.published_failed].sum(), count[series.failed].sum()
    text = f"{series.name}: {failed} of {count.sum()}, {without} without a prediction"
    return Line2D([], [], **line), text
