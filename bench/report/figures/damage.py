"""Damage of a wrong model over what a user can notice of it."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter

from olne_bench.bench.report.figures import style
from olne_bench.bench.report.formats import NotDrawnError

_SIZE = 3.6, 3.2  # of a panel [inch]
#: Panels at most: the methods made for wrong models are last.
_MOST = 9
#: Room of a name: in shares noticed, and of the ordinate.
_WIDE, _TALL = 0.3, 0.035
#: Part of the ordinate, the same in all panels, that is free above and below.
_ROOM = 0.05
#: Colours of kinds of changes.
_KINDS = {"behaviours": "#0072B2", "wrong models": "#D55E00", "wrong noise": "#5C5C3D"}
#: Errors that may be drawn, the first that a run has.
_ERRORS = {
    "ahead_error": "Error ahead",
    "ahead_2s": "Error 2 s ahead",
    "position_error": "Position error",
}


def draw(table: pd.DataFrame) -> Figure:
    """Each change as a line through its dials, a panel for each estimator that tests its fit.

    Abscissa: share of the trials in which the test notices. Ordinate: ratio of the median error
    to that where the model is true. Both are means over scenarios and sensors, the ordinate's is
    geometric. The largest dial has a point and the name. The table is that of ``damage_table``.
    """
    error = next((name for name in _ERRORS if f"{name}_ratio" in table), None)
    if error is None:
        raise NotDrawnError("the run has no errors of positions in a true world")
    ratio = f"{error}_ratio"
    tested = table[table["noticed"].notna() & np.isfinite(table[ratio]) & (table[ratio] > 0)]
    if tested.empty:
        raise NotDrawnError("no estimator tests its fit, or most of the trials failed")
    # Scenarios differ in units, so the first dials of all count together, and so on.
    place = tested.groupby(["of", "change", "sensor", "estimator"])["dial"].rank(method="dense")
    means = tested.assign(place=place, log=np.log(tested[ratio]))
    means = means.groupby(["estimator", "kind", "change", "place"], as_index=False)[
        ["noticed", "log"]
    ].mean()
    names = style.estimator_order(means["estimator"].tolist())
    figure, axes = style.grid(names, _SIZE, _MOST)
    low, high = min(means["log"].min(), 0.0), max(means["log"].max(), 0.0)
    room = _ROOM * (high - low)
    for name, panel in zip(names, axes, strict=False):
        panel.set(yscale="log", ylim=np.exp([low - room, high + room]))
        _panel(panel, means[means["estimator"] == name], _ERRORS[error])
    scenarios = tested["of"].unique()
    only = f" ({scenarios[0]})" if len(scenarios) == 1 else ""
    style.entitle(figure, f"What a wrong model costs, over what the fit test notices of it{only}")
    entries = [(Line2D([], [], color=c, marker="o", markersize=4), k) for k, c in _KINDS.items()]
    style.legend_below(figure, entries)
    return figure


def _panel(axes: Axes, means: pd.DataFrame, error: str) -> None:
    axes.set(xlim=(-0.03, 1.28), xlabel="Noticed by the fit test")
    axes.set_xticks(np.linspace(0, 1, 5))
    axes.set_ylabel(f"{error} over that of the true model")
    axes.yaxis.set_major_formatter(style.plain)
    axes.yaxis.set_minor_formatter(NullFormatter())
    style.percent(axes.xaxis)
    axes.axhline(1.0, color="black", linewidth=0.8)
    ends: list[tuple[float, float, str, str]] = []
    for (kind, change), line in means.groupby(["kind", "change"]):
        line, colour = line.sort_values("place"), _KINDS[str(kind)]
        x, y = line["noticed"].to_numpy(float), np.exp(line["log"].to_numpy(float))
        axes.plot(x, y, color=colour, linewidth=0.9, alpha=0.6)
        axes.plot(x[-1:], y[-1:], "o", color=colour, markersize=4)
        ends.append((x[-1], y[-1], str(change).replace("_", " "), colour))
    _name(axes, ends)


def _name(axes: Axes, ends: list[tuple[float, float, str, str]]) -> None:
    """Names beside points (x, y), moved up where they would cover each other."""
    low, high = np.log(axes.get_ylim())
    placed: list[tuple[float, float]] = []
    for x, y, name, colour in sorted(ends, key=lambda end: end[1]):
        height = np.log(y)
        for other, taken in placed:  # from low to high
            if abs(other - x) < _WIDE and height < taken + _TALL * (high - low):
                height = taken + _TALL * (high - low)
        placed.append((x, height))
        axes.annotate(
            name,
            (x, np.exp(height)),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
            fontsize=6,
            color=colour,
        )
