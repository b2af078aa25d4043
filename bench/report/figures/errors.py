"""Errors of the estimates over the error of the observations: the paper's main figure."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import PercentFormatter
from matplotlib.transforms import blended_transform_factory

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.figures import style
from olne_bench.bench.report.figures.rolling import RollingStatistics, rolling_statistics
from olne_bench.bench.report.figures.series import Series, split
from olne_bench.bench.report.measures import in_table
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.study import USUAL, Study

#: Points per rolling window, as in the paper.
WINDOW = 60

# A small study has smaller windows, so that there is a line at all.
_FEWEST_WINDOWS = 8  # that fit side by side
_SMALLEST_WINDOW = 5
_MANY = 150  # points of a series, from which on they are drawn small and faint
_MOST = 4000  # points and windows of a series that are drawn; more would look no different

_COLUMNS = 2  # of panels
_ABSCISSA = "Mean absolute position observation error [m]"
_TRIANGLE_STEP = 0.03  # of the panel's height, between the rows of two series
_TRIANGLES_HEIGHT = 0.3  # of the panel's height, at most, for all rows


def draw(trials: pd.DataFrame, study: Study = USUAL) -> Figure:
    """A panel for each metric that the trials of one scenario have values of.

    Raises:
        NotDrawnError: without attempts, or metrics.
    """
    series = split(trials, study)
    metrics = in_table(study.metrics, pd.concat([s.trials for s in series]))
    if not metrics:
        raise NotDrawnError("no metric has a value")
    rows = -(-len(metrics) // _COLUMNS)
    figure = Figure(figsize=(9.2, 0.5 + 3.6 * rows))
    panels = figure.subplots(rows, min(_COLUMNS, len(metrics)), squeeze=False).ravel()
    for axes in panels[len(metrics) :]:
        axes.remove()
    for axes, metric in zip(panels, metrics, strict=False):
        (_share_panel if metric.is_share else _panel)(axes, series, metric)
        axes.set(xlabel=_ABSCISSA, ylabel=style.printable(metric.title))
    figure.suptitle(f"{trials['scenario'].iloc[0]}: error of the estimates")
    style.legend_below(figure, _entries(series))
    return figure


def _share_panel(axes: Axes, series: Sequence[Series], metric: MetricDeclaration) -> None:
    """The share at each noise level, where there is one."""
    _abscissa(axes, series)
    for s in series:
        told = s.trials[s.trials[metric.name].notna()]
        if told.empty:
            continue
        levels = told.groupby("sigma")
        shares = levels[metric.name].mean()
        places = s.trials.assign(x=s.observation_error).groupby("sigma")["x"].mean()
        axes.plot(places[shares.index], shares, marker=s.marker, markersize=3.5, **_line(s))
    axes.set_ylim(-0.03, 1.03)
    axes.yaxis.set_major_formatter(PercentFormatter(xmax=1, decimals=0))


def _panel(axes: Axes, series: Sequence[Series], metric: MetricDeclaration) -> None:
    bottom = _bottom(series, metric)
    failing = [s for s in series if _failed(s, metric).any()]
    step = min(_TRIANGLE_STEP, _TRIANGLES_HEIGHT / max(len(failing), 1))
    top = _top(series, metric, bottom, reserved=0.03 + step * len(failing))
    style.log_axis(axes, bottom, top)
    _abscissa(axes, series)
    for s in series:
        _points(axes, s, metric, bottom)
    for s in series:
        _median(axes, s, metric, bottom, top)
    for row, s in enumerate(failing):
        _triangles(axes, s, metric, height=0.985 - step * row)


def _abscissa(axes: Axes, series: Sequence[Series]) -> None:
    right = max(s.observation_error.max() for s in series) or 1.0
    axes.set_xlim(-0.02 * right, 1.02 * right)


def _bottom(series: Sequence[Series], metric: MetricDeclaration) -> float:
    """Power of ten below the errors under noise; those without noise are about zero."""
    values = np.concatenate([s.error(metric)[s.trials["sigma"] > 0] for s in series])
    values = values[np.isfinite(values) & (values > metric.negligible)]
    return float(10 ** np.floor(np.log10(values.min()))) if values.size else metric.negligible


def _top(
    series: Sequence[Series], metric: MetricDeclaration, bottom: float, reserved: float
) -> float:
    """Upper limit that leaves a share of the height above the highest point."""
    values = np.concatenate([s.error(metric) for s in series])
    largest = max(values[np.isfinite(values)], default=bottom)
    decades = max(np.log10(max(largest, bottom) / bottom), 1.0)
    return bottom * 10 ** (decades / (1 - reserved))


def _points(axes: Axes, series: Series, metric: MetricDeclaration, bottom: float) -> None:
    if series.is_floor:
        return
    error = series.error(metric)
    shown = _thinned(np.isfinite(error))
    size, alpha = (2.6, 0.3) if len(error) > _MANY else (4, 0.6)
    axes.plot(
        series.observation_error[shown],
        np.maximum(error[shown], bottom),
        linestyle="none",
        marker=series.marker,
        markersize=size,
        markeredgewidth=0,
        color=series.colour,
        alpha=alpha,
        rasterized=True,
        clip_on=False,  # the outermost are drawn whole
        in_layout=False,  # they lie in the panel, and take no room beside it
    )


def _thinned(mask: np.ndarray) -> np.ndarray:
    """Places where a mask holds; of many, some all along it."""
    places = np.flatnonzero(mask)
    return places[:: 1 + len(places) // _MOST]


def rolling_errors(
    series: Series, metric: MetricDeclaration, most: int | None = None
) -> RollingStatistics:
    """Rolling median and quartiles of an error over the observation error, in windows of 60.

    Small studies have smaller windows. ``most`` is that of ``rolling_statistics``.
    """
    window = int(np.clip(series.count.sum() // _FEWEST_WINDOWS, _SMALLEST_WINDOW, WINDOW))
    about = series.measured(metric)
    return rolling_statistics(
        series.observation_error[about],
        series.error(metric)[about],
        series.count[about],
        window,
        most,
    )


def _median(
    axes: Axes, series: Series, metric: MetricDeclaration, bottom: float, top: float
) -> None:
    rolling = rolling_errors(series, metric, _MOST)
    lower, median, upper = (
        np.maximum(q, bottom) for q in (rolling.lower, rolling.median, rolling.upper)
    )
    # The line breaks where the median is infinite.
    axes.plot(rolling.x, np.where(np.isfinite(median), median, np.nan), **_line(series))
    if not series.is_floor:
        axes.fill_between(
            rolling.x,
            lower,
            np.minimum(upper, top),  # an infinite quartile fills up to the edge
            where=np.isfinite(lower),
            color=series.colour,
            alpha=0.2,
            linewidth=0,
            rasterized=True,
        )


def _failed(series: Series, metric: MetricDeclaration) -> np.ndarray:
    """The published definition of failure speaks of predictions; weights are there anyhow."""
    without = np.isinf(series.error(metric)) & series.measured(metric)
    return without | series.published_failed if metric.needs_prediction else without


def _triangles(axes: Axes, series: Series, metric: MetricDeclaration, height: float) -> None:
    failed = _thinned(_failed(series, metric))
    axes.plot(
        series.observation_error[failed],
        np.full(len(failed), height),
        transform=blended_transform_factory(axes.transData, axes.transAxes),
        linestyle="none",
        marker="^",
        markersize=4,
        markeredgewidth=0,
        color=series.colour,
        alpha=0.6,
        rasterized=True,
        clip_on=False,  # the outermost are drawn whole
        in_layout=False,  # they lie in the panel, and take no room beside it
    )


def _line(series: Series) -> dict[str, Any]:
    if series.is_floor:
        # Above the axis, on which it lies where the floor happens to be the truth.
        return {"color": series.colour, "linewidth": 1, "clip_on": False, "zorder": 3}
    return {"color": series.colour, "linestyle": series.line_style}


def _legend_line(series: Series) -> Line2D:
    line = Line2D([], [], **_line(series))
    if not series.is_floor:
        line.set(marker=series.marker, markersize=3.5)
    return line


def _entries(series: Sequence[Series]) -> list[tuple[Artist, str]]:
    entries: list[tuple[Artist, str]] = [(_legend_line(s), s.name) for s in series]
    neutral: dict[str, Any] = {"color": "0.35", "linestyle": "none", "markeredgewidth": 0}
    return [
        *entries,
        (Patch(color="0.35", alpha=0.2, linewidth=0), f"IQR (rolling, up to {WINDOW} trials)"),
        (Line2D([], [], marker="^", markersize=5, **neutral), "failed by the published definition"),
    ]
