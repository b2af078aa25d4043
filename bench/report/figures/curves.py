"""Errors as curves over the observation error, as in the paper: many levels and trials."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.transforms import blended_transform_factory

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.figures import style
from olne_bench.bench.report.figures.error_panels import (
    Entries,
    draw_floor,
    failed_entry,
    failed_rows,
    floor_entry,
    line_style,
    lower_limit,
    share_scale,
    upper_limit,
)
from olne_bench.bench.report.figures.rolling import RollingStatistics, rolling_statistics
from olne_bench.bench.report.figures.series import Series, contenders

#: Points per rolling window, as in the paper.
WINDOW = 60

_MANY = 150  # points of a series above which they are drawn small and faint
_MOST = 4000  # points and windows of a series that are drawn; more would look the same

_COLUMNS = 2  # of panels
_ABSCISSA = "Mean absolute position observation error [m]"
_TRIANGLE_STEP = 0.03  # of the panel's height, between the rows of two series
_TRIANGLES_HEIGHT = 0.3  # of the panel's height, at most, for all rows


def draw_curves(
    series: Sequence[Series], metrics: Sequence[MetricDeclaration]
) -> tuple[Figure, Entries]:
    """A figure with a panel per metric, and the entries of its legend."""
    rows = -(-len(metrics) // _COLUMNS)
    figure = Figure(figsize=(9.2, 0.5 + 3.6 * rows))
    panels = figure.subplots(rows, min(_COLUMNS, len(metrics)), squeeze=False).ravel()
    for axes in panels[len(metrics) :]:
        axes.remove()
    for axes, metric in zip(panels, metrics, strict=False):
        (_share_panel if metric.is_share else _panel)(axes, series, metric)
        axes.set(xlabel=_ABSCISSA, ylabel=style.printable(metric.title))
    return figure, _curve_entries(series, metrics)


def _share_panel(axes: Axes, series: Sequence[Series], metric: MetricDeclaration) -> None:
    """The share at each noise level that has one."""
    _abscissa(axes, series)
    for s in series:
        told = s.trials[s.trials[metric.name].notna()]
        if told.empty:
            continue
        levels = told.groupby("sigma")
        shares = levels[metric.name].mean()
        places = s.trials.assign(x=s.observation_error).groupby("sigma")["x"].mean()
        axes.plot(places[shares.index], shares, marker=s.marker, markersize=3.5, **line_style(s))
    share_scale(axes)


def _panel(axes: Axes, series: Sequence[Series], metric: MetricDeclaration) -> None:
    bottom = lower_limit(series, metric)
    failing = [s for s in series if failed_rows(s, metric).any()]
    step = min(_TRIANGLE_STEP, _TRIANGLES_HEIGHT / max(len(failing), 1))
    top = upper_limit(series, metric, bottom, reserved=0.03 + step * len(failing))
    style.log_axis(axes, bottom, top)
    _abscissa(axes, series)
    for s in series:
        if s.is_floor:
            draw_floor(axes, s, metric, bottom)
        else:
            _points(axes, s, metric, bottom)
    for s in contenders(list(series)):
        if not s.is_floor:
            _median(axes, s, metric, bottom, top)
    for row, s in enumerate(failing):
        _triangles(axes, s, metric, height=0.985 - step * row)


def _abscissa(axes: Axes, series: Sequence[Series]) -> None:
    right = max(s.observation_error.max() for s in series) or 1.0
    axes.set_xlim(-0.02 * right, 1.02 * right)


def _points(axes: Axes, series: Series, metric: MetricDeclaration, bottom: float) -> None:
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
        in_layout=False,  # inside the panel, so it needs no room beside it
    )


def _thinned(mask: np.ndarray) -> np.ndarray:
    """Places where a mask is true; if there are many, an even selection."""
    places = np.flatnonzero(mask)
    return places[:: 1 + len(places) // _MOST]


def rolling_errors(
    series: Series, metric: MetricDeclaration, most: int | None = None
) -> RollingStatistics:
    """Rolling median and quartiles of an error over the observation error, in windows of 60.

    ``most`` is as in ``rolling_statistics``.
    """
    about = series.measured(metric)
    return rolling_statistics(
        series.observation_error[about],
        series.error(metric)[about],
        series.count[about],
        WINDOW,
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
    axes.plot(rolling.x, np.where(np.isfinite(median), median, np.nan), **line_style(series))
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


def _triangles(axes: Axes, series: Series, metric: MetricDeclaration, height: float) -> None:
    failed = _thinned(failed_rows(series, metric))
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
        in_layout=False,  # inside the panel, so it needs no room beside it
    )


def _curve_entries(series: Sequence[Series], metrics: Sequence[MetricDeclaration]) -> Entries:
    entries: Entries = []
    drawn = [s for s in series if not s.is_floor]
    curved = [s for s in drawn if s.count.sum() >= WINDOW]
    for s in series:
        if s.is_floor:
            entries.append(floor_entry(s))
        else:
            line = Line2D([], [], marker=s.marker, markersize=3.5, **line_style(s))
            if s not in curved:  # too few trials for a curve
                line.set_linestyle("none")
            entries.append((line, s.name))
    if curved:
        band = Patch(color="0.35", alpha=0.2, linewidth=0)
        entries.append((band, f"quartiles (rolling, {WINDOW} trials)"))
    return [*entries, *failed_entry(drawn, metrics, "failed by the published definition")]
