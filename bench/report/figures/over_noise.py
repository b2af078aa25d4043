"""What changes with the noise: errors of estimates, failures, and what stays unknown of weights."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
import scipy
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.figures import style
from olne_bench.bench.report.formats import NotDrawnError
from olne_bench.bench.report.leaderboard import errors_by_noise, published_failures
from olne_bench.bench.report.scenes import tried
from olne_bench.bench.report.statistics.attempts import FLOOR
from olne_bench.bench.report.study import USUAL, Study, in_table, primary

_ERRORS, _FAILURES, _KNOWN = (3.5, 2.9), (3.5, 2.6), (3.4, 2.9)  # sizes of a panel [inch]
_DECADES = 5  # of errors at most, below the largest one
_PAIR = 2  # sensors, of which three metrics are drawn
_LEAST = 0.05  # of the upper end of failures


def draw_errors(trials: pd.DataFrame, study: Study = USUAL) -> Figure:
    """Median errors at each noise level with 95 % intervals, a panel for each metric and sensor.

    There are six at most, the primary metric first. Where half of the trials fail, there is no
    point.
    """
    attempts = tried(trials)
    first = primary(study.metrics)
    known = [m for m in in_table(study.metrics, attempts) if m.drawn and not m.is_share]
    metrics = sorted(known, key=lambda metric: metric != first)
    if not metrics:
        raise NotDrawnError("no metric has a value")
    sensors = style.sensor_order(attempts["sensor"].tolist())
    metrics = metrics[: max(1, style.MOST_PANELS // len(sensors))]
    table = errors_by_noise(attempts, study, metrics)
    places = [(metric, sensor) for metric in metrics for sensor in sensors]
    if len(sensors) == _PAIR:  # three metrics of a sensor in a row, not an odd mixture
        places = [(metric, sensor) for sensor in sensors for metric in metrics]
    figure, axes = style.grid([sensor for _, sensor in places], _ERRORS)
    for (metric, sensor), panel in zip(places, axes, strict=False):
        _errors(panel, table, metric, sensor)
    scenario = trials["scenario"].iloc[0]
    style.entitle(figure, f"{scenario}: median errors with 95 % intervals of the medians")
    names = style.estimator_order(table["estimator"].tolist())
    style.legend_below(figure, style.estimator_entries(names))
    return figure


def _errors(axes: Axes, table: pd.DataFrame, metric: MetricDeclaration, sensor: str) -> None:
    columns = [f"{metric.name}_{kind}" for kind in ("median", "low", "high")]
    levels = sorted(table["sigma"].unique())
    bottom, top = _limits(table, columns[0], metric)
    style.log_axis(axes, bottom, top)
    style.levels_axis(axes, levels)
    axes.set_ylabel(style.printable(metric.title))
    own = table[table["sensor"] == sensor].sort_values("sigma")
    names = style.estimator_order(own["estimator"].tolist())
    shifts = dict(zip(names, style.offsets(len(names)), strict=True))
    shifts |= {FLOOR: 0.0} if FLOOR in shifts else {}
    own = own.assign(**own[columns].astype(float).clip(lower=bottom))
    _series(axes, own, columns, levels, shifts)


def _series(
    axes: Axes,
    table: pd.DataFrame,
    columns: Sequence[str],
    levels: Sequence[float],
    shifts: Mapping[str, float],
) -> None:
    """A line of each estimator that is shifted, from columns of its middle, low and high values."""
    for name, shift in shifts.items():
        rows = table[table["estimator"] == name]
        x = np.array([levels.index(sigma) for sigma in rows["sigma"]]) + shift
        values = rows[[*columns]].to_numpy(float).T
        style.with_interval(axes, x, values, style.estimator_looks(name))


def _limits(table: pd.DataFrame, column: str, metric: MetricDeclaration) -> tuple[float, float]:
    """Powers of ten around the medians of all sensors; errors without noise are about zero."""
    values = table.loc[table["sigma"] > 0, column].to_numpy(float)
    values = values[np.isfinite(values) & (values > metric.negligible)]
    if not values.size:
        return metric.negligible, 10 * metric.negligible
    top = np.ceil(np.log10(values.max()) + 0.1)
    bottom = max(np.floor(np.log10(values.min())), top - _DECADES)
    return float(10**bottom), float(10**top)


def draw_failures(trials: pd.DataFrame) -> Figure:
    """Share of failures by the published definition with 95 % Wilson intervals, by sensor.

    The legend gives the number of trials without any prediction.
    """
    attempts = tried(trials)
    names = style.estimator_order(attempts["estimator"].tolist())
    levels = sorted(attempts["sigma"].unique())
    figure, panels = style.by_sensor(attempts, _FAILURES)
    tables = [failure_shares(own) for _, own in panels]
    top = min(1.02, 1.05 * max(_LEAST, *(table["high"].max() for table in tables)))
    shifts = dict(zip(names, style.offsets(len(names)), strict=True))
    for (panel, _), table in zip(panels, tables, strict=True):
        panel.set(ylim=(-0.02 * top, top), ylabel="Failed trials, published definition")
        style.levels_axis(panel, levels)
        style.percent(panel.yaxis)
        _series(panel, table, ("share", "low", "high"), levels, shifts)
    style.entitle(figure, f"{trials['scenario'].iloc[0]}: failures, with 95 % Wilson intervals")
    entries = zip(style.estimator_entries(names), names, strict=True)
    style.legend_below(figure, [(key, _told(attempts, name)) for (key, _), name in entries])
    return figure


def _told(attempts: pd.DataFrame, name: str) -> str:
    rows = attempts[attempts["estimator"] == name]
    published = int(rows["count"][published_failures(rows)].sum())
    without = int(rows["count"][rows["status"] != "ok"].sum())
    total = int(rows["count"].sum())
    return f"{style.printable(name)}: {published} of {total}, {without} without a prediction"


def failure_shares(attempts: pd.DataFrame) -> pd.DataFrame:
    """Per estimator and noise level: ``share`` of failed trials and its interval ``low, high``.

    Rows that stand for several equal sequences are not random: low and high are the share itself.
    """
    levels = []
    for (estimator, sigma), rows in attempts.groupby(["estimator", "sigma"]):
        weights = rows["count"].to_numpy(int)
        failed = published_failures(rows)
        share = low = high = weights[failed].sum() / weights.sum()
        if (weights == 1).all():
            interval = scipy.stats.binomtest(int(failed.sum()), len(rows)).proportion_ci(
                method="wilson"
            )
            low, high = interval.low, interval.high
        known = {"estimator": estimator, "sigma": sigma}
        levels.append(known | {"share": share, "low": low, "high": high})
    return pd.DataFrame(levels)


def draw_identifiability(table: pd.DataFrame) -> Figure:
    """Share of the prior variance that is left of each weight, one panel per sensor.

    A colour is a weight, and a line one player's, or an unknown parameter's. The table has the rows
    of ``identifiability_by_noise`` of one scenario.
    """
    if table.empty:
        raise NotDrawnError("there is no noise, or no truth that can be played here")
    colours = {name: f"C{k % 10}" for k, name in enumerate(dict.fromkeys(table["weight"]))}
    levels = sorted(table["sigma"].unique())
    figure, panels = style.by_sensor(table, _KNOWN)
    for panel, own in panels:
        panel.set(ylim=(-0.02, 1.02), ylabel="Left of the prior variance")
        style.levels_axis(panel, levels)
        style.percent(panel.yaxis)
        for (_, name), rows in own.sort_values("sigma").groupby(["player", "weight"], sort=False):
            x = [levels.index(sigma) for sigma in rows["sigma"]]
            panel.plot(x, rows["left"], "o-", color=colours[name], markersize=3, linewidth=1.1)
    draws = int(table["draws"].max())
    of = f", mean of {draws} draws" if draws > 1 else ""
    style.entitle(
        figure, f"{table['scenario'].iloc[0]}: what noise leaves unknown of each weight{of}"
    )
    keys = {name: Line2D([], [], color=colour, marker="o") for name, colour in colours.items()}
    style.legend_below(figure, [(key, style.printable(name)) for name, key in keys.items()])
    return figure
