"""Who is recognised, and who is mistaken for whom: temperaments of drivers."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from olne_bench.bench.report.figures import style
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.statistics.recognition import NOBODY, confusion_table, drivers
from olne_bench.bench.report.study import USUAL, Study
from olne_bench.envs.roads.temperaments import TEMPERAMENTS

_MOST_LEVELS = 5
_WIDTH, _HEIGHT = 1.25, 0.95  # [inch] of a panel
_MARGIN = 1.5, 1.3  # [inch]
_DARK = 0.55  # shares above it have white numbers


def draw(trials: pd.DataFrame, study: Study = USUAL) -> Figure:
    """Shares of drivers by true and recognised temperament, over all sensors.

    There is a column of panels per estimator and a row per noise level, five at most. Each row of a
    panel sums to 100 %. The last column are drivers for whom there is no estimate.

    Raises:
        NotDrawnError: if no driver has a temperament.
    """
    found = drivers(trials, study)
    if found.empty:
        raise NotDrawnError("no driver has a temperament")
    levels = _some(sorted(found["sigma"].unique()))
    estimators = style.estimator_order(found["estimator"].unique().tolist())
    figure = Figure(
        figsize=(len(estimators) * _WIDTH + _MARGIN[0], len(levels) * _HEIGHT + _MARGIN[1])
    )
    panels = figure.subplots(len(levels), len(estimators), squeeze=False)
    pooled = confusion_table(found.assign(sensor=""))
    for row, sigma in zip(panels, levels, strict=True):
        for axes, estimator in zip(row, estimators, strict=True):
            here = (pooled["sigma"] == sigma) & (pooled["estimator"] == estimator)
            _panel(axes, pooled[here])
        row[0].set_yticks(range(len(TEMPERAMENTS)), list(TEMPERAMENTS))
        row[0].set_ylabel(f"σ = {sigma:g} m")
    for axes, estimator in zip(panels[0], estimators, strict=True):
        axes.set_title(style.printable(estimator), fontsize=8)
    for axes in panels[-1]:
        names = [*TEMPERAMENTS, NOBODY]
        axes.set_xticks(range(len(names)), names, rotation=90)
    count = len(found[["seed"]].drop_duplicates())
    figure.suptitle(
        f"{trials['scenario'].iloc[0]}: who is recognised\n"
        f"true temperament in rows, recognised one in columns [%]\n{count} draws, all sensors",
        fontsize=9,
    )
    return figure


def _panel(axes: Axes, counts: pd.DataFrame) -> None:
    table = counts.pivot_table("share", "temperament", "recognised")
    shares = table.reindex(index=list(TEMPERAMENTS), columns=[*TEMPERAMENTS, NOBODY])
    seen = shares.notna().any(axis=1)  # temperaments that nobody has stay empty
    values = shares.fillna(0.0).where(seen, np.nan, axis=0).to_numpy(float)
    axes.imshow(values, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for (i, j), share in np.ndenumerate(values):
        if share > 0:
            colour = "white" if share > _DARK else "black"
            axes.text(j, i, f"{100 * share:.0f}", ha="center", va="center", color=colour, size=7)
    axes.grid(visible=False)
    axes.set_xticks([])
    axes.set_yticks([])


def _some(levels: list[float]) -> list[float]:
    """The levels, or so many of them, evenly chosen."""
    if len(levels) <= _MOST_LEVELS:
        return levels
    places = np.linspace(0, len(levels) - 1, _MOST_LEVELS).round().astype(int)
    return [levels[k] for k in places]
