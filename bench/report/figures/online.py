"""Figures of estimates while a motion goes on: streams, and drives of planners that use them."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter, SymmetricalLogLocator

from olne_bench.bench.plan.kinds import REFERENCES
from olne_bench.bench.report.figures import style
from olne_bench.bench.report.statistics.attempts import attempts_of

#: Columns of the panels of streams, and how they are called.
_MEASURES = {
    "cosine_error": "Cosine error",
    "fde_1s": "Position error 1 s ahead [m]",
    "fde_3s": "Position error 3 s ahead [m]",
    "latency": "Latency [s]",
}
_REFERENCES = REFERENCES["streams"]
_SPARSE, _LONG = (0, (1, 3)), (0, (8, 2))
_REFERENCE_STYLES = {
    name: {"color": "#555555", "linestyle": line, "linewidth": 1.1}
    for name, line in zip(_REFERENCES, (*style.LINE_STYLES[::-1], _SPARSE, _LONG), strict=True)
}
_COLOURS = ("#1b1b1b", "#8a8a8a", "#4f9d69", "#b06a2c", "#5b7f95", "#7a5195")
_PLANNER_COLOURS = dict(zip(REFERENCES["drives"], _COLOURS, strict=True))
_LINEAR = 0.01  # regrets below it are on a linear scale
_SIZE, _DRIVE_SIZE = (4.2, 2.5), (3.4, 2.8)  # of a panel [inch]
_WIDE, _STEP = (7.0, 3.2), 0.11  # of the figure by value, and between planners in it
#: Planners whose regret does not depend on what they know of the others.
_NOT_BY_VALUE = ("oracle", "stock", "ppo")
_QUARTILES = (0.25, 0.5, 0.75)


def stream_figures(rows: pd.DataFrame) -> Iterator[tuple[str, Figure]]:
    """Names and figures of an ``update_table``, one for each scenario, sensor and noise level."""
    judged = attempts_of(rows)
    for (scenario, sensor), part in judged.groupby(["scenario", "sensor"], sort=False):
        levels = part.groupby("sigma")
        for sigma, own in levels:
            name = f"online_{scenario}_{sensor}" + f"_{sigma:g}" * (len(levels) > 1)
            where = f"{style.printable(str(scenario))}, {style.printable(str(sensor))}"
            yield name, _stream(f"{where}, σ = {sigma:g} m", own)


def _stream(title: str, rows: pd.DataFrame) -> Figure:
    """Medians over motions and their quartiles over the time since the start, a panel a measure.

    Samples before the first estimate have no errors.
    """
    shown = [name for name in _MEASURES if rows[name].notna().any()]
    figure, axes = style.grid([_MEASURES[name] for name in shown], _SIZE)
    estimators = [n for n in rows["estimator"].unique() if n not in _REFERENCES]
    references = [n for n in _REFERENCES if n in set(rows["estimator"])]
    names = [*references, *style.estimator_order(estimators)]
    for panel, measure in zip(axes, shown, strict=True):
        for name in names:
            _draw(panel, rows[rows["estimator"] == name], measure, name)
        panel.set_yscale("log")
        panel.yaxis.set_major_formatter(style.plain)
        panel.yaxis.set_minor_formatter(NullFormatter())
        panel.set_xlabel("Time since the first sample [s]")
    motions = rows["seed"].nunique()
    style.entitle(
        figure,
        f"{title}: estimates after each sample\n"
        f"(median and quartiles of {motions} motion{'s' if motions != 1 else ''})",
    )
    entries = [(Line2D([], [], **_looks(name)), style.printable(name)) for name in names]
    style.legend_below(figure, entries)
    return figure


def _looks(name: str) -> dict[str, Any]:
    return _REFERENCE_STYLES.get(name) or {"color": style.estimator_colours(name)[0]}


def _draw(axes: Axes, rows: pd.DataFrame, measure: str, name: str) -> None:
    """Median over motions at each time, and quartiles of estimators."""
    by_time = rows[rows[measure].notna()].groupby("time")[measure]
    low, middle, high = (by_time.quantile(share) for share in _QUARTILES)
    times, looks = middle.index.to_numpy(float), _looks(name)
    axes.plot(times, middle, **looks)
    if name not in _REFERENCES:
        axes.fill_between(times, low, high, alpha=0.15, linewidth=0, color=looks["color"])


def drive_figures(table: pd.DataFrame) -> Iterator[tuple[str, Figure]]:
    """Names and figures of a ``drive_table`` of one noise level, one for each traffic."""
    for traffic, part in table.groupby("traffic", sort=False):
        yield f"driving_{traffic}", _drives(str(traffic), part)


def _drives(traffic: str, table: pd.DataFrame) -> Figure:
    """A panel for each road: mean regret and share of collisions, with 95 % intervals."""
    roads = list(dict.fromkeys(table["road"]))[-style.MOST_PANELS :]  # all of them are the last
    counts = table.groupby("road")["drives"].max()
    titles = [f"{'all roads' if r == 'all' else r}, {counts[r]} drives" for r in roads]
    figure, axes = style.grid(titles, _DRIVE_SIZE)
    handles = {}
    for panel, road in zip(axes, roads, strict=True):
        for row in table[table["road"] == road].to_dict("records"):
            handles[row["planner"]] = _point(panel, row)
        panel.set(xlabel="Regret (1: a step of standing)", ylabel="Drives with a collision [%]")
        _, most = panel.get_ylim()
        panel.set_ylim(-most / 20, most)  # below zero there is room for markers only
        panel.set_yticks([tick for tick in panel.get_yticks() if 0 <= tick <= most])
        panel.set_xscale("symlog", linthresh=_LINEAR)
        panel.xaxis.set_major_formatter(style.plain)
    style.entitle(
        figure,
        f"Regret against the oracle, and collisions: {traffic} traffic, "
        f"σ = {table['sigma'].iloc[0]:g} m (95 % intervals)",
    )
    style.legend_below(figure, [(handles[name], style.printable(name)) for name in handles])
    return figure


def quarter_figures(table: pd.DataFrame) -> Iterator[tuple[str, Figure]]:
    """Name and figure of a ``quarter_table``: regret of planners by the value of information."""
    parts = table[table["quarter"] != "all"]
    known = [name for name in _PLANNER_COLOURS if name not in _NOT_BY_VALUE]
    others = [name for name in parts["planner"].unique() if name not in _PLANNER_COLOURS]
    planners = [*others, *(name for name in known if name in set(parts["planner"]))]
    figure, (axes,) = style.grid(["Over all roads"], _WIDE)
    quarters = sorted(parts["quarter"].unique())
    handles: dict[str, Any] = {}
    for number, name in enumerate(planners):
        own = parts[parts["planner"] == name].set_index("quarter").reindex(quarters)
        places = np.arange(len(quarters)) + (number - (len(planners) - 1) / 2) * _STEP
        ends = [100 * own[f"regret{end}"].to_numpy(float) for end in ("", "_low", "_high")]
        reach = np.nan_to_num(np.maximum([ends[0] - ends[1], ends[2] - ends[0]], 0.0))
        handles[name] = axes.errorbar(places, ends[0], yerr=reach, **_marks(name))
    axes.axhline(0.0, color="#999999", linewidth=0.8, zorder=0)
    whole = parts.loc[parts.groupby("quarter")["drives"].idxmax()].set_index("quarter")
    drives, values = whole["drives"], whole["value"]
    axes.set_xticks(range(len(quarters)))
    labels = [
        f"quarter {quarter}\nvalue {100 * values[quarter]:.2g} %\n{drives[quarter]} draws"
        for quarter in quarters
    ]
    axes.set_xticklabels(labels)
    axes.set_ylabel("Regret [% of what standing costs]")
    axes.set_yscale("symlog", linthresh=1.0)
    ticks = SymmetricalLogLocator(base=10, linthresh=1.0, subs=[1.0, 2.0, 5.0])
    axes.yaxis.set_major_locator(ticks)
    axes.yaxis.set_major_formatter(style.plain)
    style.entitle(
        figure, "Regret against the oracle, by the value of knowing the others (95 % intervals)"
    )
    own = parts.groupby("planner")["drives"].sum()
    few = {name: f", {own[name]} drives" for name in handles if own[name] < drives.sum()}
    names = [(handles[name], style.printable(name) + few.get(name, "")) for name in handles]
    style.legend_below(figure, names)
    yield "regret_by_value", figure


def _marks(planner: str) -> dict[str, Any]:
    colour = _PLANNER_COLOURS.get(planner) or style.estimator_colours(planner)[0]
    reference = planner in _PLANNER_COLOURS
    return {
        "fmt": "D" if reference else "o",
        "color": colour,
        "markersize": 5,
        "linewidth": 1.0,
    }


def _point(axes: Axes, row: dict[Any, Any]) -> Any:
    ends = ("", "_low", "_high")
    percent = np.array([100 * row[f"collision{end}"] for end in ends])
    regret = np.array([row[f"regret{end}"] for end in ends])
    bars: dict[str, Any] = {"xerr": _reach(regret), "yerr": _reach(percent)}
    return axes.errorbar(regret[0], percent[0], **bars, **_marks(row["planner"]))


def _reach(values: np.ndarray) -> np.ndarray:
    """How far an interval (estimate, low, high) reaches to both sides; nothing if there is none."""
    reach = np.array([[values[0] - values[1]], [values[2] - values[0]]])
    return np.asarray(np.nan_to_num(np.maximum(reach, 0.0)))
