"""Errors level by level, a row per metric and a column per sensor: for few levels or trials."""

from collections.abc import Sequence
from dataclasses import replace

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.figures import style
from olne_bench.bench.report.figures.error_panels import (
    Entries,
    draw_floor,
    failed_entry,
    failed_rows,
    floor_entry,
    lower_limit,
    share_scale,
    upper_limit,
)
from olne_bench.bench.report.figures.levels import (
    Slots,
    draw_levels,
    draw_shares,
    has_quartiles,
    median_style,
)
from olne_bench.bench.report.figures.series import Series, contenders

_ABSCISSA = "Noise level σ [m]"
_COUNTS_HEIGHT = 0.14  # of the panel's height, for triangles with numbers
#: Widths of panels [in]: of one among many, of one among two, and what one number needs.
_NARROW, _WIDE, _PER_NUMBER = 3.4, 4.6, 0.088


def draw_level_panels(
    series: Sequence[Series], metrics: Sequence[MetricDeclaration]
) -> tuple[Figure, Entries]:
    """A figure with a row per metric and a column per sensor, and the entries of its legend."""
    drawn = [_in_own_colour(s) for s in contenders(list(series)) if not s.is_floor]
    floor = next((s for s in series if s.is_floor), None)
    sensors = list(dict.fromkeys(s.sensor for s in drawn or series))
    estimators = style.estimator_order([s.estimator for s in drawn])
    slots = Slots(series, estimators)
    needed = _PER_NUMBER * len(slots.levels) * (len(estimators) + 1)
    width = _WIDE if len(sensors) <= 2 else min(max(_NARROW, needed), _WIDE)
    figure = Figure(figsize=(max(4.8, width * len(sensors)), 0.6 + 2.9 * len(metrics)))
    panels = figure.subplots(len(metrics), len(sensors), squeeze=False)
    for axes, sensor in zip(panels[0], sensors, strict=True):
        axes.set_title(style.printable(sensor))
    for axes in panels[-1]:
        axes.set_xlabel(_ABSCISSA)
    for row, metric in zip(panels, metrics, strict=True):
        row[0].set_ylabel(style.printable(metric.title))
        limits = None if metric.is_share else _limits(series, metric)
        for axes, sensor in zip(row, sensors, strict=True):
            slots.frame(axes)
            axes.tick_params(labelleft=axes is row[0])
            own = [s for s in drawn if s.sensor == sensor]
            if limits is None:
                _share_panel(axes, own, slots, metric)
            else:
                _error_panel(axes, own, floor, slots, metric, limits)
    return figure, _level_entries(drawn, floor, metrics)


def _in_own_colour(series: Series) -> Series:
    """A series in its estimator's colour: each sensor has its own panel."""
    return replace(series, colour=style.estimator_colours(series.estimator)[0], line_style="-")


def _limits(series: Sequence[Series], metric: MetricDeclaration) -> tuple[float, float]:
    """Limits of the ordinate, the same for all sensors."""
    bottom = lower_limit(series, metric)
    some_failed = any(failed_rows(s, metric).any() for s in series if not s.is_floor)
    reserved = _COUNTS_HEIGHT if some_failed else 0.03
    return bottom, upper_limit(series, metric, bottom, reserved)


def _share_panel(
    axes: Axes, own: Sequence[Series], slots: Slots, metric: MetricDeclaration
) -> None:
    share_scale(axes)
    for s in own:
        draw_shares(axes, s, slots, metric)


def _error_panel(
    axes: Axes,
    own: Sequence[Series],
    floor: Series | None,
    slots: Slots,
    metric: MetricDeclaration,
    limits: tuple[float, float],
) -> None:
    style.log_axis(axes, *limits)
    axes.yaxis.set_minor_locator(NullLocator())  # panels are small, and ticks slow
    if floor is not None:
        draw_floor(axes, floor, metric, limits[0])
    for s in own:
        draw_levels(axes, s, slots, metric, failed_rows(s, metric), *limits)


def _level_entries(
    drawn: Sequence[Series], floor: Series | None, metrics: Sequence[MetricDeclaration]
) -> Entries:
    entries: Entries = []
    for s in {s.estimator: s for s in drawn}.values():
        entries.append((Line2D([], [], **median_style(s)), style.printable(s.estimator)))
    if floor is not None:
        entries.append(floor_entry(floor))
    if drawn:
        trial = Line2D([], [], color="0.35", marker=".", linestyle="none", markeredgewidth=0)
        middle = Line2D([], [], color="0.35", marker="o", linestyle="none", markersize=4)
        entries += [(trial, "one trial"), (middle, "median")]
    if has_quartiles(drawn):
        bar = Line2D([], [], color="0.35", linewidth=3, alpha=0.4)
        entries.append((bar, "quartiles"))
    return [*entries, *failed_entry(drawn, metrics, "number of failures, as published")]
