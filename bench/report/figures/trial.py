"""One trial: truth, what was seen, and what two estimators predict."""

import math
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from olne_bench.bench.report.figures import style
from olne_bench.bench.report.scenes import Scene, choose, shown_trial
from olne_bench.bench.report.study import USUAL, Study
from olne_bench.envs.worlds.scene import car_outline, player_colour

_AREA, _ROAD_AREA = 6.5, 9.5  # [inch^2] of a panel beside others; cars take some room
_WIDTH = 7.2  # [inch] of a panel below others
_GAP, _MARGIN = (0.25, 0.45), (0.3, 1.1)  # [inch] beside and below a panel; around all
_ASPHALT, _LANE_MARK = "#DADBDE", "#FFFFFF"
_DASHES, _TRUTH_STYLE = (0, (5, 5)), (0, (3, 1.5))


def draw(trials: pd.DataFrame, study: Study = USUAL) -> Figure:
    """Truth and observations of a trial that ``scenes.choose`` picks, and two predictions."""
    choice = choose(trials, study)
    seed, scene, rows, found = shown_trial(trials, choice, study)
    figure, panels = _panels(scene)
    for i, path in enumerate(scene.observed(choice.sigma, seed).swapaxes(0, 1)):
        panels[0].plot(*scene.plane(path), ".", color=player_colour(i), markersize=4)
    panels[0].set_title("Truth and what was seen")
    for axes, row, states in zip(panels[1:], rows, found, strict=True):
        _prediction(axes, scene, row, states)
    for axes in panels:
        _truth(axes, scene)
    stretched = f" ({scene.axis_names[1]} stretched × {scene.stretch:g})"
    note = stretched if scene.stretch > 1 else ""
    style.entitle(
        figure,
        f"{scene.name}, draw {seed}: σ = {choice.sigma:g} m, sensor {choice.sensor}{note}\n"
        "the draw in which their errors differ by the median amount",
    )
    style.legend_below(figure, _entries(scene))
    return figure


def _panels(scene: Scene) -> tuple[Figure, list[Axes]]:
    """A figure with three panels, beside each other unless the scene is wide."""
    width, height = scene.extents
    height *= scene.stretch
    area = _ROAD_AREA if scene.on_road else _AREA
    wide = _WIDTH if scene.is_wide else math.sqrt(area * width / height)
    rows, columns = (3, 1) if scene.is_wide else (1, 3)
    size = (
        columns * (wide + _GAP[0]) + _MARGIN[0],
        rows * (wide * height / width + _GAP[1]) + _MARGIN[1],
    )
    figure = Figure(figsize=size)
    panels = figure.subplots(rows, columns, sharex=True, sharey=True)
    for axes in panels:
        vertical = scene.limits[1][::-1] if scene.on_road else scene.limits[1]
        axes.set(xlim=scene.limits[0], ylim=vertical, aspect=scene.stretch)
        _road(axes, scene)
    for axes in panels if not scene.is_wide else panels[-1:]:
        axes.set_xlabel(f"{scene.axis_names[0]} [m]")
    for axes in panels if scene.is_wide else panels[:1]:
        axes.set_ylabel(f"{scene.axis_names[1]} [m]")
    return figure, list(panels)


def _road(axes: Axes, scene: Scene) -> None:
    """Draw the lanes as areas, and the lines between them."""
    if not scene.lanes:
        return
    axes.set_facecolor("#F6F6F3")
    axes.grid(visible=False)
    areas = [np.vstack([shape.edges[0], shape.edges[1][::-1]]) for shape in scene.lanes]
    axes.add_collection(PolyCollection(areas, facecolor=_ASPHALT, linewidth=0, zorder=0.5))
    for kind, dashes in (("solid", "-"), ("dashed", _DASHES)):
        lines = [
            edge
            for shape in scene.lanes
            for edge, mark in zip(shape.edges, shape.marks, strict=True)
            if mark == kind
        ]
        axes.add_collection(
            LineCollection(lines, color=_LANE_MARK, linewidth=1.1, linestyle=dashes, zorder=0.6)
        )


def _car(axes: Axes, scene: Scene, state: np.ndarray, colour: str, label: str = "") -> None:
    """Draw a vehicle at a state (n,): a car on a road, elsewhere a dot; filled with a label."""
    x, y = (float(value) for value in scene.plane(state))
    if scene.on_road:
        face = to_rgba(colour, 1.0 if label else 0.15)
        outline = car_outline(state)
        axes.add_patch(Polygon(outline, facecolor=face, edgecolor=colour, linewidth=0.8, zorder=3))
    else:
        axes.plot(x, y, "o", color=colour, markersize=7 if label else 3, markeredgewidth=0)
    if label:
        text = axes.text(x, y, label, color="white", ha="center", va="center_baseline")
        text.set(fontsize=5.5, fontweight="bold", zorder=4, clip_on=True)


def _prediction(axes: Axes, scene: Scene, row: dict[Any, Any], states: np.ndarray) -> None:
    for i, path in enumerate(states.swapaxes(0, 1)):
        axes.plot(*scene.plane(path), color=player_colour(i), linewidth=2)
        _car(axes, scene, path[-1], player_colour(i))
    name = style.printable(str(row["estimator"]))
    axes.set_title(f"{name} predicts, {row['position_error']:.2g} m off")


def _truth(axes: Axes, scene: Scene) -> None:
    """Draw the true paths, numbered where they start, with the cars at their ends."""
    for i, path in enumerate(scene.truth.states.swapaxes(0, 1)):
        axes.plot(*scene.plane(path), color="black", linewidth=1, linestyle=_TRUTH_STYLE)
        _car(axes, scene, path[0], "black", label=str(i))
        _car(axes, scene, path[-1], "black")


def _entries(scene: Scene) -> list[tuple[Artist, str]]:
    """Entries of a legend: the truth, each player's colour, and where cars are at the end."""
    truth = Line2D([], [], color="black", linewidth=1, linestyle=_TRUTH_STYLE)
    players: list[tuple[Artist, str]] = [
        (Line2D([], [], color=player_colour(i)), f"player {i}")
        for i in range(scene.truth.states.shape[1])
    ]
    end = Patch(facecolor=to_rgba("black", 0.15), edgecolor="black")
    return [(truth, "truth, numbered where it starts"), *players, (end, "end")]
