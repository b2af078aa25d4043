"""Errors level by level, for studies with too few noise levels or trials for a rolling curve."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.figures.series import Series, contenders
from olne_bench.bench.report.statistics.attempts import quantile
from olne_bench.bench.report.statistics.intervals import share_interval

#: Least number of noise levels, and of trials of an estimator, for a rolling curve.
CURVE_LEVELS, CURVE_TRIALS = 10, 120

_FEWEST = 4  # trials of a level for quartiles
_SPREAD, _STEP = 0.9, 0.18  # of the distance between two levels: for all slots, and at most each
_MANY = 40  # points of a level above which they are drawn fainter
_COUNT_SIZE = 6.5  # [pt] of the number of failures
_FAILED_HEIGHT, _BAR_HEIGHT = 0.955, 0.86  # of the panel's height
_BESIDE = 3  # series of a level whose numbers do not touch each other if they lie


@dataclass(frozen=True)
class LevelStatistics:
    """Statistics of L noise levels over all attempts; failures are infinite.

    Attributes:
        sigma: (L,) noise levels.
        x: (L,) mean observation error [m].
        lower: (L,) first quartile; NaN where a level has too few trials.
        median: (L,) median.
        upper: (L,) third quartile, as ``lower``.
        failed: (L,) number of trials that failed.
    """

    sigma: np.ndarray
    x: np.ndarray
    lower: np.ndarray
    median: np.ndarray
    upper: np.ndarray
    failed: np.ndarray


def has_curve(series: Sequence[Series]) -> bool:
    """Whether a study has enough levels and trials for rolling curves."""
    levels = {sigma for s in series for sigma in s.trials["sigma"]}
    trials = max((int(s.count.sum()) for s in contenders(list(series))), default=0)
    return len(levels) >= CURVE_LEVELS and trials >= CURVE_TRIALS


def has_quartiles(series: Sequence[Series]) -> bool:
    """Whether any level of any series has enough trials for quartiles."""
    return any(s.trials.groupby("sigma")["count"].sum().ge(_FEWEST).any() for s in series)


def level_statistics(
    series: Series, metric: MetricDeclaration, failed: np.ndarray
) -> LevelStatistics:
    """Median and quartiles of an error at each noise level that has any.

    Args:
        series: series of one estimator and sensor.
        metric: metric of the error.
        failed: (rows,) which rows count as failed.
    """
    errors, about, count = series.error(metric), series.measured(metric), series.count
    sigmas = series.trials["sigma"].to_numpy(float)
    rows = []
    for sigma in np.unique(sigmas[about | failed]):
        here = sigmas == sigma
        values, weights = errors[here & about], count[here & about]
        shares = [quantile(values, weights, share) for share in (0.25, 0.5, 0.75)]
        if weights.sum() < _FEWEST:
            shares[0] = shares[2] = np.nan
        place = series.observation_error[here].mean()
        rows.append((sigma, place, *shares, count[here & failed].sum()))
    columns = np.array(rows, dtype=float).reshape(-1, 6).T
    return LevelStatistics(*columns)


class Slots:
    """Places side by side for the series of a panel, at every noise level.

    Args:
        series: series of all panels that share the levels.
        estimators: their labels, from left to right.

    Attributes:
        levels: noise levels, ascending.
        crowded: whether counts beside each other would touch.
    """

    def __init__(self, series: Sequence[Series], estimators: Sequence[str]) -> None:
        self.levels = sorted({float(sigma) for s in series for sigma in s.trials["sigma"]})
        number = len(estimators)
        offsets = (np.arange(number) - (number - 1) / 2) * min(_STEP, _SPREAD / max(number, 1))
        self.crowded = number > _BESIDE
        self._offsets = dict(zip(estimators, offsets, strict=True))
        self._index = {sigma: k for k, sigma in enumerate(self.levels)}

    def places(self, series: Series, sigmas: np.ndarray) -> np.ndarray:
        """Abscissae of a series at these noise levels."""
        return np.array([self._index[float(s)] for s in sigmas]) + self._offsets[series.estimator]

    def frame(self, axes: Axes) -> None:
        """Set limits and ticks of the abscissa, with evenly spaced levels."""
        axes.set_xlim(-0.55, len(self.levels) - 0.45)
        crowded = len(self.levels) > 8
        labels = [f"{sigma:g}" for sigma in self.levels]
        axes.set_xticks(range(len(labels)), labels, rotation=60 if crowded else 0)
        axes.grid(visible=False, axis="x")
        for border in range(1, len(labels)):
            axes.axvline(border - 0.5, color="0.9", linewidth=0.8, zorder=0)


def draw_levels(
    axes: Axes,
    series: Series,
    slots: Slots,
    metric: MetricDeclaration,
    failed: np.ndarray,
    bottom: float,
    top: float,
) -> None:
    """Draw points, quartiles and median of each level, and the number of failures."""
    error = series.error(metric)
    shown = np.isfinite(error) & series.measured(metric)
    axes.plot(
        slots.places(series, series.trials["sigma"].to_numpy()[shown]),
        np.maximum(error[shown], bottom),
        linestyle="none",
        marker=".",
        markersize=4,
        markeredgewidth=0,
        color=series.colour,
        alpha=0.25 if len(error) > _MANY * len(slots.levels) else 0.5,
        rasterized=True,
        clip_on=False,
        in_layout=False,
    )
    told = level_statistics(series, metric, failed)
    places = slots.places(series, told.sigma)
    known = np.isfinite(told.lower)
    # An infinite quartile reaches up to the failures.
    ceiling = bottom * (top / bottom) ** _BAR_HEIGHT if told.failed.any() else top
    low, high = np.clip((told.lower[known], told.upper[known]), bottom, ceiling)
    axes.vlines(places[known], low, high, **_bar_style(series))
    median = np.where(np.isfinite(told.median), np.maximum(told.median, bottom), np.nan)
    axes.plot(places, median, **median_style(series))
    _count_failures(axes, series, places, told.failed, upright=slots.crowded)


def draw_shares(axes: Axes, series: Series, slots: Slots, metric: MetricDeclaration) -> None:
    """Draw the share at each level, with its 95 % interval if there are enough trials."""
    told = series.trials[series.measured(metric) & series.trials[metric.name].notna().to_numpy()]
    for sigma, rows in told.groupby("sigma"):
        values = rows[metric.name].to_numpy(float)
        family = series.study.is_family(str(rows["scenario"].iloc[0]))
        units = rows["seed"].to_numpy() if family else np.arange(len(rows))
        share = share_interval(values, units)
        place = slots.places(series, np.array([sigma]))
        axes.vlines(place, share.low, share.high, **_bar_style(series))
        axes.plot(place, [share.estimate], **median_style(series))


def _bar_style(series: Series) -> dict[str, Any]:
    return {"color": series.colour, "linewidth": 3, "alpha": 0.4}


def median_style(series: Series) -> dict[str, Any]:
    """Marker style of a level's median or share."""
    return {
        "linestyle": "none",
        "marker": series.marker,
        "markersize": 4.2,
        "markeredgecolor": "white",
        "markeredgewidth": 0.5,
        "color": series.colour,
        "clip_on": False,
        "zorder": 4,
    }


def _count_failures(
    axes: Axes, series: Series, places: np.ndarray, failed: np.ndarray, *, upright: bool
) -> None:
    across = axes.get_xaxis_transform()
    some = failed > 0
    if not some.any():
        return
    axes.plot(
        places[some],
        np.full(some.sum(), _FAILED_HEIGHT),
        transform=across,
        linestyle="none",
        marker="^",
        markersize=4,
        markeredgewidth=0,
        color=series.colour,
    )
    for place, number in zip(places[some], failed[some], strict=True):
        axes.annotate(
            f"{number:.0f}",
            (place, _FAILED_HEIGHT),
            xycoords=across,
            xytext=(0, -4),
            textcoords="offset points",
            ha="center",
            va="top",
            rotation=90 if upright else 0,
            fontsize=_COUNT_SIZE,
            color=series.colour,
        )
