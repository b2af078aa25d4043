"""Errors of the estimates over the noise."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.figures import panels, style
from olne_bench.bench.report.measures import in_table, primary
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.statistics.attempts import attempts_of
from olne_bench.bench.report.statistics.noise_errors import errors_by_noise
from olne_bench.bench.report.study import USUAL, Study

_SIZE = 3.5, 2.9  # of a panel [inch]
_DECADES = 5  # at most, below the largest error


def draw(trials: pd.DataFrame, study: Study = USUAL) -> Figure:
    """Median errors at each noise level with 95 % intervals, a panel for each metric and sensor.

    There are six at most: of as many sensors as there are, the primary metric first. A failure
    counts as infinitely wrong; where half of the trials fail, there is no point.

    Raises:
        NotDrawnError: if there are no attempts or no metrics.
    """
    attempts = attempts_of(trials)
    if attempts.empty:
        raise NotDrawnError("nothing was attempted")
    first = primary(study.metrics)
    known = [m for m in in_table(study.metrics, attempts) if m.drawn and not m.is_share]
    metrics = sorted(known, key=lambda metric: metric != first)
    if not metrics:
        raise NotDrawnError("no metric has a value")
    sensors = style.sensor_order(attempts["sensor"].tolist())
    metrics = metrics[: max(1, panels.MOST_PANELS // len(sensors))]
    table = errors_by_noise(attempts, study, metrics)
    places = [(metric, sensor) for metric in metrics for sensor in sensors]
    figure, axes = panels.grid([sensor for _, sensor in places], _SIZE)
    for (metric, sensor), panel in zip(places, axes, strict=False):
        _panel(panel, table, metric, sensor)
    scenario = trials["scenario"].iloc[0]
    figure.suptitle(f"{scenario}: median errors with 95 % intervals of the medians")
    names = style.estimator_order(table["estimator"].tolist())
    style.legend_below(figure, panels.estimator_entries(names))
    return figure


def _panel(axes: Axes, table: pd.DataFrame, metric: MetricDeclaration, sensor: str) -> None:
    columns = [f"{metric.name}_{kind}" for kind in ("median", "low", "high")]
    levels = sorted(table["sigma"].unique())
    bottom, top = _limits(table, columns[0], metric)
    style.log_axis(axes, bottom, top)
    panels.levels_axis(axes, levels)
    axes.set_ylabel(style.printable(metric.title))
    own = table[table["sensor"] == sensor]
    names = style.estimator_order(own["estimator"].tolist())
    for name, shift in zip(names, panels.offsets(len(names)), strict=True):
        rows = own[own["estimator"] == name].sort_values("sigma")
        values = np.maximum(rows[columns].to_numpy(float).T, bottom)
        x = np.array([levels.index(sigma) for sigma in rows["sigma"]])
        floor = name == style.FLOOR
        panels.with_interval(axes, x if floor else x + shift, values, panels.estimator_looks(name))


def _limits(table: pd.DataFrame, column: str, metric: MetricDeclaration) -> tuple[float, float]:
    """Powers of ten around the medians of all sensors; errors without noise are about zero."""
    values = table.loc[table["sigma"] > 0, column].to_numpy(float)
    values = values[np.isfinite(values) & (values > metric.negligible)]
    if not values.size:
        return metric.negligible, 10 * metric.negligible
    top = np.ceil(np.log10(values.max()) + 0.1)
    bottom = max(np.floor(np.log10(values.min())), top - _DECADES)
    return float(10**bottom), float(10**top)
