"""Regret against collisions of planners that drive."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from olne_bench.bench.plan.kinds import REFERENCES
from olne_bench.bench.report.figures import style
from olne_bench.bench.report.formats import USUAL_FORMATS

_COLOURS = ("#1b1b1b", "#8a8a8a", "#b06a2c", "#5b7f95", "#7a5195")
_REFERENCE_COLOURS = dict(zip(REFERENCES["drives"], _COLOURS, strict=True))
_LINEAR = 0.01  # regrets below it are on a linear scale
_WIDTH, _HEIGHT, _COLUMNS = 3.4, 2.8, 3  # of a panel [inch], and panels side by side


def draw_driving(
    table: pd.DataFrame, directory: Path, formats: Sequence[str] = USUAL_FORMATS
) -> list[Path]:
    """Draw ``driving_<traffic>`` of each traffic; the files written.

    Args:
        table: as ``report.driving.drive_table`` makes it.
        directory: folder for the files.
        formats: some of ``FORMATS``.
    """
    files = []
    with style.applied():
        for traffic, part in table.groupby("traffic", sort=False):
            stem = directory / style.file_name(f"driving_{traffic}")
            files += style.save(figure_of(str(traffic), part), stem, formats)
    return files


def figure_of(traffic: str, table: pd.DataFrame) -> Figure:
    """A panel for each road: mean regret and share of collisions, with 95 % intervals.

    Args:
        traffic: the others.
        table: lines of one noise level.
    """
    roads = list(dict.fromkeys(table["road"]))
    lines = -(-len(roads) // _COLUMNS)
    columns = min(_COLUMNS, len(roads))
    figure = Figure(figsize=(max(2, columns) * _WIDTH, lines * _HEIGHT))
    panels = figure.subplots(lines, columns, squeeze=False).ravel()
    planners = list(dict.fromkeys(table["planner"]))
    handles = {}
    for axes, road in zip(panels, roads, strict=False):
        for planner in planners:
            own = table[(table["road"] == road) & (table["planner"] == planner)]
            if len(own):
                handles[planner] = _point(axes, own.iloc[0], planner)
        drives = int(table[table["road"] == road]["drives"].max())
        axes.set_title(f"{'all roads' if road == 'all' else road}, {drives} drives")
        axes.set_xlabel("Regret (1: a step of standing)")
        axes.set_ylabel("Drives with a collision [%]")
        _, most = axes.get_ylim()
        axes.set_ylim(-most / 20, most)  # below zero there is room for markers only
        axes.set_yticks([tick for tick in axes.get_yticks() if 0 <= tick <= most])
        axes.set_xscale("symlog", linthresh=_LINEAR)
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    for axes in panels[len(roads) :]:
        axes.set_axis_off()
    figure.suptitle(
        f"Regret against the oracle, and collisions: {traffic} traffic, "
        f"σ = {table['sigma'].iloc[0]:g} m "
        "(95 % intervals)"
    )
    style.legend_below(figure, [(handles[name], style.printable(name)) for name in handles])
    return figure


def _point(axes: Axes, line: pd.Series, planner: str) -> Any:
    colour = _REFERENCE_COLOURS.get(planner) or style.estimator_colours(planner)[0]
    percent = 100 * line[["collision", "collision_low", "collision_high"]].to_numpy(float)
    regret = line[["regret", "regret_low", "regret_high"]].to_numpy(float)
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
