"""What figures share: grids of at most six panels, medians with their intervals, scales."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import PercentFormatter

from olne_bench.bench.report.figures import style

#: Panels of a figure: more could not be read.
MOST_PANELS = 6
_COLUMNS = 3
#: Width of the names of a legend's entries, and their lines.
Entries = list[tuple[Artist, str]]


def grid(titles: Sequence[str], size: tuple[float, float]) -> tuple[Figure, list[Axes]]:
    """A figure with a panel for each of the first six titles.

    Args:
        titles: titles of the panels.
        size: width and height of a panel [inch].
    """
    number = min(len(titles), MOST_PANELS)
    columns = min(number, 2 if number == 4 else _COLUMNS)
    rows = -(-number // columns)
    figure = Figure(figsize=(max(columns * size[0], 4.8), rows * size[1] + 0.5))
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels[number:]:
        axes.remove()
    for axes, title in zip(panels, titles, strict=False):
        axes.set_title(style.printable(title))
    return figure, list(panels[:number])


def levels_axis(axes: Axes, levels: Sequence[float]) -> None:
    """An abscissa of noise levels, evenly spaced."""
    labels = [f"{level:g}" for level in levels]
    axes.set_xticks(range(len(levels)), labels, rotation=60 if len(levels) > 8 else 0)
    axes.set_xlim(-0.5, len(levels) - 0.5)
    axes.set_xlabel("Noise level σ [m]")


def offsets(number: int) -> np.ndarray:
    """Shifts (number,) that keep the intervals of a level apart."""
    return np.linspace(-0.3, 0.3, number) if number > 1 else np.zeros(1)


def with_interval(axes: Axes, x: Any, values: np.ndarray, looks: dict[str, Any]) -> None:
    """Points joined by a line, with a bar from low to high where these are known.

    Args:
        axes: the panel.
        x: abscissae (P,).
        values: (3, P) middle, low, high; an infinite middle breaks the line.
        looks: colour, marker and so on.
    """
    middle, low, high = values
    _, top = axes.get_ylim()
    axes.vlines(x, low, np.minimum(high, top), color=looks["color"], alpha=0.55, linewidth=1.6)
    axes.plot(x, np.where(np.isfinite(middle), middle, np.nan), **looks)


def estimator_looks(name: str) -> dict[str, Any]:
    """Colour and marker of an estimator."""
    if name == style.FLOOR:
        return {"color": style.FLOOR_COLOUR, "linewidth": 1.0, "marker": ""}
    colour, marker = style.estimator_colours(name)[0], style.estimator_marker(name)
    return {"color": colour, "marker": marker, "markersize": 4, "linewidth": 1.1}


def estimator_entries(names: Sequence[str]) -> Entries:
    """Entries of a legend for estimators."""
    return [(Line2D([], [], **estimator_looks(n)), style.printable(n)) for n in names]


def percent(axis: Any) -> None:
    """Show shares as percentages."""
    axis.set_major_formatter(PercentFormatter(xmax=1, decimals=0))
