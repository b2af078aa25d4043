"""Predictions of recorded cars on their lanes."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse

from olne_bench.bench.report.figures import style
from olne_bench.envs.tracks.grid import Grid
from olne_bench.envs.tracks.prediction import Foreseen
from olne_bench.envs.tracks.road import Road, locate

_GAME, _STRAIGHT, _LANE, _PAST = "#0B6E99", "#C4572B", "#D0D2D6", "#8A8F98"
_HOLLOW: dict[str, Any] = {"linestyle": "", "markerfacecolor": "none"}
_MARGIN = 12.0  # [m] around what is shown
_WIDTH, _LEAST, _MOST = 8.0, 3.0, 9.0  # [inch]


def film(found: Sequence[Foreseen], grid: Grid, road: Road, at: float) -> Iterator[np.ndarray]:
    """Frames (height, width, 3) uint8 of ``draw``, one for each time that is predicted."""
    for step in range(len(found[0].times)):
        canvas = FigureCanvasAgg(draw(found, grid, road, at, step))
        canvas.draw()  # type: ignore[no-untyped-call]
        yield np.asarray(canvas.buffer_rgba())[..., :3].copy()  # type: ignore[no-untyped-call]


def draw(found: Sequence[Foreseen], grid: Grid, road: Road, at: float, step: int = -1) -> Figure:
    """Lanes, the way so far, what is predicted up to a step, with 90 % regions, and what happened.

    The place that is shown is that of all steps.
    """
    shown = np.concatenate([np.vstack([one.game, one.straight, one.recorded]) for one in found])
    shown = shown[np.isfinite(shown).all(axis=1)]
    low, high = shown.min(axis=0) - _MARGIN, shown.max(axis=0) + _MARGIN
    height = np.clip(_WIDTH * (high - low)[1] / (high - low)[0], _LEAST, _MOST)
    figure = Figure(figsize=(_WIDTH, float(height) + 0.8))
    axes = figure.subplots()
    for lane in road.lanes.values():
        axes.plot(*lane.line.T, color=_LANE, linewidth=1, zorder=0)
    before = grid.times <= at + 1e-6
    step %= len(found[0].times)
    for one in (_so_far(each, step + 1) for each in found):
        past = grid.states[before, grid.players.index(one.player), :2]
        axes.plot(*past.T, color=_PAST, linewidth=1.2)
        axes.plot(*one.straight.T, color=_STRAIGHT, linewidth=1.2, linestyle=(0, (3, 2)))
        axes.plot(*one.game.T, color=_GAME, linewidth=1.8)
        axes.plot(*one.recorded[::2].T, ".", color="black", markersize=3.5)
        axes.plot(*one.game[0], "s", color=_PAST, markersize=4)
        axes.plot(*one.straight[-1], "x", color=_STRAIGHT, markersize=6, zorder=5)
        axes.plot(*one.game[-1], "o", color=_GAME, markersize=5, zorder=5)
        axes.plot(*one.recorded[-1], "o", color="black", zorder=6, **_HOLLOW)
        if step:
            axes.add_patch(_region(one))
        if len(found) <= 12:
            axes.annotate(
                style.printable(one.player), one.game[0], (0, 5), textcoords="offset points"
            )
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x [m]", ylabel="y [m]")
    axes.set_aspect("equal")
    seconds = found[0].times[step]
    style.entitle(figure, f"{len(found)} cars, {seconds:g} s ahead of {at:g} s")
    style.legend_below(
        figure,
        [
            (Line2D([], [], color=_PAST), "seen"),
            (Line2D([], [], color=_GAME, marker="o", markersize=5), "game, 90 % region"),
            (Line2D([], [], color=_STRAIGHT, linestyle="--", marker="x"), "straight on"),
            (Line2D([], [], color="black", marker="o", **_HOLLOW), "what happened"),
        ],
    )
    return figure


def _so_far(one: Foreseen, steps: int) -> Foreseen:
    """The first steps of what is predicted of a car."""
    parts = {name: getattr(one, name)[:steps] for name in ("times", "game", "straight", "recorded")}
    return replace(one, **parts)


def _region(one: Foreseen) -> Ellipse:
    angle = float(np.rad2deg(locate(one.way, one.game[-1:]).heading[0]))
    return Ellipse(
        tuple(one.game[-1]),
        *(2 * one.half_widths[-1]),
        angle=angle,
        facecolor=_GAME,
        alpha=0.3,
    )
