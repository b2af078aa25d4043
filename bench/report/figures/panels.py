"""Panels that show the same part of the plane."""

import math
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from olne_bench.bench.report.figures.scene import Scene

_AREA, _ROAD_AREA = 6.5, 9.5  # [inch^2] of a panel beside others; cars take some room
_WIDTH = 7.2  # [inch] of a panel below others
_GAP = 0.25, 0.45  # [inch] beside and below a panel


def scene_panels(
    scene: Scene,
    places: Sequence[tuple[int, int]],
    margin: tuple[float, float],
    lanes: bool = True,
) -> tuple[Figure, list[Axes]]:
    """A figure with a panel at each (row, column), framed by the scene.

    Args:
        scene: the scene that the panels show.
        places: rows and columns of the panels; the grid may have gaps.
        margin: width and height [inch] for what lies around the panels.
        lanes: whether a road is drawn.
    """
    rows, columns = (1 + max(numbers) for numbers in zip(*places, strict=True))
    width, height = scene.extents
    height *= scene.stretch
    area = _ROAD_AREA if scene.on_road else _AREA
    panel_width = _WIDTH if scene.is_wide else math.sqrt(area * width / height)
    panel_height = panel_width * height / width
    figure = Figure(
        figsize=(
            columns * (panel_width + _GAP[0]) + margin[0],
            rows * (panel_height + _GAP[1]) + margin[1],
        )
    )
    grid = figure.add_gridspec(rows, columns)
    panels = []
    for row, column in places:
        axes = figure.add_subplot(grid[row, column])
        scene.frame(axes, lanes)
        leftmost = column == min(c for r, c in places if r == row)
        lowest = row == max(r for r, c in places if c == column)
        axes.tick_params(labelleft=leftmost, labelbottom=lowest)
        if not leftmost:
            axes.set_ylabel("")
        if not lowest:
            axes.set_xlabel("")
        panels.append(axes)
    return figure, panels
