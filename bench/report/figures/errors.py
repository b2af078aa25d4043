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
from matplotlib.transforms import blended_transform_factory

from olne_bench.bench.report.figures import style
from olne_bench.bench.report.figures.rolling import RollingStatistics, rolling_statistics
from olne_bench.bench.report.figures.series import Series, split

#: Points per rolling window, as in the paper.
WINDOW = 60

# A small study has smaller windows, so that there is a line at all.
_FEWEST_WINDOWS = 8  # that fit side by side
_SMALLEST_WINDOW = 5
_MANY = 150  # points of a series, from which on they are drawn small and faint
_MOST = 4000  # points and windows of a series that are drawn; more would look no different

_PANELS = {
    "cosine_error": "Cosine error of the weights [-]",
    "position_error": "Mean absolute position prediction error [m]",
}
_ABSCISSA = "Mean absolute position observation error [m]"

#: Errors below are solver noise and of no interest; they are drawn at the lower edge.
_SMALLEST = {"cosine_error": 1e-7, "position_error": 1e-5}
_TRIANGLE_STEP = 0.03  # of the panel's height, between the rows of two series
_TRIANGLES_HEIGHT = 0.3  # of the panel's height, at most, for all rows


def draw(trials: pd.DataFrame) -> Figure | None:
    """Two panels for the trials of one scenario, or None where there was no attempt."""
    series = split(trials)
    if not series:
        return None
    figure = Figure(figsize=(9.2, 4.1))
    panels = figure.subplots(1, len(_PANELS))
    for axes, (column, label) in zip(panels, _PANELS.items(), strict=True):
        _panel(axes, series, column)
        axes.set(xlabel=_ABSCISSA, ylabel=label)
    figure.suptitle(f"{trials['scenario'].iloc[0]}: error of the estimates")
    style.legend_below(figure, _entries(series))
    return figure


def _panel(axes: Axes, series: Sequence[Series], column: str) -> None:
    bottom = _bottom(series, column)
    failing = [s for s in series if _failed(s, column).any()]
    step = min(_TRIANGLE_STEP, _TRIANGLES_HEIGHT / max(len(failing), 1))
    top = _top(series, column, bottom, reserved=0.03 + step * len(failing))
    style.log_axis(axes, bottom, top)
    right = max(s.observation_error.max() for s in series) or 1.0
    axes.set_xlim(-0.02 * right, 1.02 * right)
    for s in series:
        _points(axes, s, column, bottom)
    for s in series:
        _median(axes, s, column, bottom, top)
    for row, s in enumerate(failing):
        _triangles(axes, s, column, height=0.985 - step * row)


def _bottom(series: Sequence[Series], column: str) -> float:
    """Power of ten below the errors under noise; those without noise are about zero."""
    values = np.concatenate([s.error(column)[s.trials["sigma"] > 0] for s in series])
    values = values[np.isfinite(values) & (values > _SMALLEST[column])]
    return float(10 ** np.floor(np.log10(values.min()))) if values.size else _SMALLEST[column]


def _top(series: Sequence[Series], column: str, bottom: float, reserved: float) -> float:
    """Upper limit that leaves a share of the height above the highest point."""
    values = np.concatenate([s.error(column) for s in series])
    largest = max(values[np.isfinite(values)], default=bottom)
    decades = max(np.log10(max(largest, bottom) / bottom), 1.0)
    return bottom * 10 ** (decades / (1 - reserved))


def _points(axes: Axes, series: Series, column: str, bottom: float) -> None:
    if series.is_floor:
        return
    error = series.error(column)
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


def rolling_errors(series: Series, column: str, most: int | None = None) -> RollingStatistics:
    """Rolling median and quartiles of an error over the observation error, in windows of 60.

    Small studies have smaller windows. ``most`` is that of ``rolling_statistics``.
    """
    window = int(np.clip(series.count.sum() // _FEWEST_WINDOWS, _SMALLEST_WINDOW, WINDOW))
    return rolling_statistics(
        series.observation_error, series.error(column), series.count, window, most
    )


def _median(axes: Axes, series: Series, column: str, bottom: float, top: float) -> None:
    rolling = rolling_errors(series, column, _MOST)
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


def _failed(series: Series, column: str) -> np.ndarray:
    """The published definition of failure speaks of predictions; weights are there anyhow."""
    without = np.isinf(series.error(column))
    return without | series.published_failed if column == "position_error" else without


def _triangles(axes: Axes, series: Series, column: str, height: float) -> None:
    failed = _thinned(_failed(series, column))
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
