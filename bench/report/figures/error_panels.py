"""What panels of errors share: scales, the floor, which trials failed, legends."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import PercentFormatter

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.figures.series import Series
from olne_bench.bench.report.statistics.attempts import quantile

#: Entries of a legend.
Entries = list[tuple[Artist, str]]


def share_scale(axes: Axes) -> None:
    """An ordinate for shares from 0 to 1."""
    axes.set_ylim(-0.03, 1.03)
    axes.yaxis.set_major_formatter(PercentFormatter(xmax=1, decimals=0))


def lower_limit(series: Sequence[Series], metric: MetricDeclaration) -> float:
    """Power of ten below the errors of trials with noise; errors without noise are about zero."""
    values = np.concatenate([s.error(metric)[s.trials["sigma"] > 0] for s in series])
    values = values[np.isfinite(values) & (values > metric.negligible)]
    return float(10 ** np.floor(np.log10(values.min()))) if values.size else metric.negligible


def upper_limit(
    series: Sequence[Series], metric: MetricDeclaration, bottom: float, reserved: float
) -> float:
    """Upper limit that leaves a share of the height above the highest point."""
    values = np.concatenate([s.error(metric) for s in series])
    largest = max(values[np.isfinite(values)], default=bottom)
    decades = max(np.log10(max(largest, bottom) / bottom), 1.0)
    return bottom * 10 ** (decades / (1 - reserved))


def draw_floor(axes: Axes, series: Series, metric: MetricDeclaration, bottom: float) -> None:
    """One line at the floor's median: it uses no observation, so noise does not matter."""
    median = floor_error(series, metric)
    if np.isfinite(median):
        # Drawn over the axis, where the line lies if the floor happens to be the truth.
        axes.axhline(max(median, bottom), clip_on=False, zorder=3, **line_style(series))


def floor_error(series: Series, metric: MetricDeclaration) -> float:
    """Median error of the floor over all its trials."""
    about = series.measured(metric)
    return quantile(series.error(metric)[about], series.count[about], 0.5)


def failed_rows(series: Series, metric: MetricDeclaration) -> np.ndarray:
    """Which rows failed; the published definition counts only if a metric needs a prediction."""
    without = np.isinf(series.error(metric)) & series.measured(metric)
    return without | series.published_failed if metric.needs_prediction else without


def line_style(series: Series) -> dict[str, Any]:
    """Colour and dashes of a series' line."""
    if series.is_floor:
        return {"color": series.colour, "linewidth": 1}
    return {"color": series.colour, "linestyle": series.line_style}


def floor_entry(series: Series) -> tuple[Artist, str]:
    """The legend's entry for the floor."""
    return Line2D([], [], **line_style(series)), series.name


def failed_entry(
    drawn: Sequence[Series], metrics: Sequence[MetricDeclaration], text: str
) -> Entries:
    """The legend's entry for triangles; empty if no trial failed."""
    errors = [metric for metric in metrics if not metric.is_share]
    if not any(failed_rows(s, metric).any() for s in drawn for metric in errors):
        return []
    grey = {"color": "0.35", "linestyle": "none", "markeredgewidth": 0}
    return [(Line2D([], [], marker="^", markersize=5, **grey), text)]  # type: ignore[arg-type]
