"""Regret against collisions of planners that drive."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from olne_bench.bench.plan.kinds import REFERENCES
from olne_bench.bench.report.figures import panels, style

_COLOURS = ("#1b1b1b", "#8a8a8a", "#b06a2c", "#5b7f95", "#7a5195")
_REFERENCE_COLOURS = dict(zip(REFERENCES["drives"], _COLOURS, strict=True))
_LINEAR = 0.01  # regrets below it are on a linear scale
_SIZE = 3.4, 2.8  # of a panel [inch]


def figures_of(table: pd.DataFrame) -> Iterator[tuple[str, Figure]]:
    """Names and figures of a study, one for each traffic.

    Args:
        table: as ``report.drive_tables.drive_table`` makes it.
    """
    for traffic, part in table.groupby("traffic", sort=False):
        yield f"driving_{traffic}", figure_of(str(traffic), part)


def figure_of(traffic: str, table: pd.DataFrame) -> Figure:
    """A panel for each road: mean regret and share of collisions, with 95 % intervals.

    Args:
        traffic: the others.
        table: lines of one noise level.
    """
    roads = list(dict.fromkeys(table["road"]))[-panels.MOST_PANELS :]  # all of them are the last
    counts = table.groupby("road")["drives"].max()
    titles = [f"{'all roads' if r == 'all' else r}, {counts[r]} drives" for r in roads]
    figure, axes = panels.grid(titles, _SIZE)
    handles = {}
    for panel, road in zip(axes, roads, strict=True):
        for row in table[table["road"] == road].to_dict("records"):
            handles[row["planner"]] = _point(panel, row)
        panel.set(xlabel="Regret (1: a step of standing)", ylabel="Drives with a collision [%]")
        _, most = panel.get_ylim()
        panel.set_ylim(-most / 20, most)  # below zero there is room for markers only
        panel.set_yticks([tick for tick in panel.get_yticks() if 0 <= tick <= most])
        panel.set_xscale("symlog", linthresh=_LINEAR)
        panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    figure.suptitle(
        f"Regret against the oracle, and collisions: {traffic} traffic, "
        f"σ = {table['sigma'].iloc[0]:g} m (95 % intervals)"
    )
    style.legend_below(figure, [(handles[name], style.printable(name)) for name in handles])
    return figure


def _point(axes: Axes, row: dict[Any, Any]) -> Any:
    planner = row["planner"]
    colour = _REFERENCE_COLOURS.get(planner) or style.estimator_colours(planner)[0]
    ends = ("", "_low", "_high")
    percent = np.array([100 * row[f"collision{end}"] for end in ends])
    regret = np.array([row[f"regret{end}"] for end in ends])
    return axes.errorbar(
        regret[0],
        percent[0],
        xerr=_reach(regret),
        yerr=_reach(percent),
        fmt="D" if planner in _REFERENCE_COLOURS else "o",
        color=colour,
        markersize=5,
        linewidth=1.0,
    )


def _reach(values: np.ndarray) -> np.ndarray:
    """How far an interval (estimate, low, high) reaches to both sides; nothing if there is none."""
    reach = np.array([[values[0] - values[1]], [values[2] - values[0]]])
    return np.nan_to_num(np.maximum(reach, 0.0))
