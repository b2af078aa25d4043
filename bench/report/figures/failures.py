"""How often estimators fail, over the noise level."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.stats import binomtest

from olne_bench.bench.report.figures import panels, style
from olne_bench.bench.report.leaderboard import published_failures
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.statistics.attempts import attempts_of
from olne_bench.bench.report.study import USUAL, Study

_SIZE = 3.5, 2.6  # of a panel [inch]
_LEAST = 0.05  # of the ordinate's upper end


def draw(trials: pd.DataFrame, _: Study = USUAL) -> Figure:
    """Share of failures by the published definition with 95 % Wilson intervals, by sensor.

    The legend gives the number of trials without any prediction.

    Raises:
        NotDrawnError: if there are no attempts.
    """
    attempts = attempts_of(trials)
    if attempts.empty:
        raise NotDrawnError("nothing was attempted")
    sensors = style.sensor_order(attempts["sensor"].tolist())
    names = style.estimator_order(attempts["estimator"].tolist())
    levels = sorted(attempts["sigma"].unique())
    figure, axes = panels.grid(sensors, _SIZE)
    tables = [failure_shares(attempts[attempts["sensor"] == sensor]) for sensor in sensors]
    top = min(1.02, 1.05 * max(_LEAST, *(table["high"].max() for table in tables)))
    for panel, table in zip(axes, tables, strict=False):
        panel.set(ylim=(-0.02 * top, top), ylabel="Failed trials, published definition")
        panels.levels_axis(panel, levels)
        panels.percent(panel.yaxis)
        for name, shift in zip(names, panels.offsets(len(names)), strict=True):
            rows = table[table["estimator"] == name]
            x = np.array([levels.index(sigma) for sigma in rows["sigma"]]) + shift
            values = rows[["share", "low", "high"]].to_numpy(float).T
            panels.with_interval(panel, x, values, panels.estimator_looks(name))
    figure.suptitle(f"{trials['scenario'].iloc[0]}: failures, with 95 % Wilson intervals")
    entries = zip(panels.estimator_entries(names), names, strict=True)
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

    Rows that stand for several equal sequences (sigma = 0) are not random and have no interval: low
    and high are the share itself.
    """
    levels = []
    for (estimator, sigma), rows in attempts.groupby(["estimator", "sigma"]):
        weights = rows["count"].to_numpy(int)
        failed = published_failures(rows)
        share = low = high = weights[failed].sum() / weights.sum()
        if (weights == 1).all():
            interval = binomtest(int(failed.sum()), len(rows)).proportion_ci(method="wilson")
            low, high = interval.low, interval.high
        known = {"estimator": estimator, "sigma": sigma}
        levels.append(known | {"share": share, "low": low, "high": high})
    return pd.DataFrame(levels)
