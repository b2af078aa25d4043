"""Pictures of a drive from above: cars to scale, the ego's plan, and what it expects of others."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from olne_bench.envs.drive.cars import STEP
from olne_bench.envs.drive.planner import EgoPlan
from olne_bench.envs.drive.world import DriveWorld
from olne_bench.envs.roads.road_shapes import lane_shapes
from olne_bench.envs.worlds.scene import car_outline

_EGO, _OTHER, _EXPECTED, _HIT = "#0a5ab4", "#5b6470", "#c8421f", "#d40000"
_ASPHALT = "#E3E5E8"
#: What is shown around the ego along a road that goes on, and around the middle of others [m].
_BEHIND, _AHEAD, _BESIDE, _TOWN = 35.0, 75.0, 12.0, (52.0, 44.0)
_SECOND = round(1.0 / STEP)
_DPI, _NARROW = 80, (5.4, 5.4)


def picture(
    world: DriveWorld, plan: EgoPlan | None, caption: str, *, small: bool = False
) -> np.ndarray:
    """One frame (height, width, 3) uint8 of a drive; only its cars where there is no plan.

    The caption's first part says who drives where. A small one of a town is half as wide.
    """
    states, moving = world.states(), world.moving
    narrow = small and not moving
    size = (9.0, 3.0) if moving else _NARROW if narrow else (9.0, 8.3)
    text, rows = (9, 2) if narrow else (11, 1)
    figure = Figure(figsize=size, dpi=_DPI)
    canvas = FigureCanvasAgg(figure)
    figure.subplots_adjust(left=0.01, right=0.99, top=0.99 - 0.3 / figure.get_figheight())
    figure.subplots_adjust(bottom=(0.2 + 0.22 * rows) / figure.get_figheight())
    axes = figure.subplots()
    _road(axes, world, states[0])
    if plan is not None:
        _expected(axes, plan)
    for place, state in enumerate(states):
        colour = _OTHER if place else _HIT if world.crashed else _EGO
        outline = car_outline(state)
        axes.add_patch(Polygon(outline, facecolor=colour, edgecolor="white", zorder=4))
    x, y = states[0, :2]
    axes.text(x, y, "ego", ha="center", va="center", fontsize=text - 2, color="white", zorder=5)
    end = "  collision" if world.crashed else ""
    title = f"{caption}   {world.step * STEP:4.1f} s, {states[0, 3]:4.1f} m/s{end}"
    axes.set_title(title, loc="left", fontsize=text, pad=4)
    keys: dict[str, Any] = {"loc": "lower center", "frameon": False, "fontsize": min(text, 10)}
    figure.legend(handles=_keys(plan), ncols=6 // rows, **keys)
    canvas.draw()  # type: ignore[no-untyped-call]
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()  # type: ignore[no-untyped-call]


def _road(axes: Axes, world: DriveWorld, ego: np.ndarray) -> None:
    """The lanes around an ego in a state (4,)."""
    low, high = -np.array(_TOWN), np.array(_TOWN)
    if world.moving:
        low, high = ego[0] - np.array([_BEHIND, 50.0]), ego[0] + np.array([_AHEAD, 50.0])
        low[1], high[1] = -50.0, 50.0
    shapes = lane_shapes(world.setting.road, low - 10, high + 10)
    lanes = [np.vstack([shape.edges[0], shape.edges[1][::-1]]) for shape in shapes]
    if world.moving:
        across = np.concatenate(lanes)[:, 1] if lanes else ego[1:2]  # behind the end of a merge
        middle = (across.min() + across.max()) / 2
        low[1], high[1] = middle - _BESIDE, middle + _BESIDE
    axes.add_collection(PolyCollection(lanes, facecolor=_ASPHALT, edgecolor="white", zorder=0.5))
    # As HighwayEnv draws its roads: y grows downwards.
    axes.set(xlim=(low[0], high[0]), ylim=(high[1], low[1]), aspect="equal", xticks=[], yticks=[])
    axes.spines[:].set_visible(False)


def _expected(axes: Axes, plan: EgoPlan) -> None:
    """Lines with a dot each second; thin ones with bars for each guess at the others' minds."""
    for motion in () if plan.guesses is None else plan.guesses:
        for place in range(1, motion.shape[1]):
            way = motion[:, place, :2].T
            axes.plot(*way, color=_EXPECTED, linewidth=0.8, alpha=0.35, zorder=2)
            axes.plot(*way[:, _SECOND::_SECOND], "|", color=_EXPECTED, alpha=0.6, zorder=2)
    for place in range(len(plan.numbers) - 1, -1, -1):  # the ego's plan on top
        colour = _EXPECTED if place else _EGO
        way = plan.states[:, place, :2].T
        axes.plot(*way, color=colour, linewidth=2, zorder=3)
        axes.plot(*way[:, _SECOND::_SECOND], "o", color=colour, markersize=4, zorder=3)


def _keys(plan: EgoPlan | None) -> list[Patch | Line2D]:
    keys: list[Patch | Line2D] = [
        Patch(facecolor=_EGO, label="ego"),
        Patch(facecolor=_OTHER, label="other car"),
    ]
    if plan is not None:
        dots: dict[str, Any] = {"marker": "o", "markersize": 4}
        keys.append(Line2D([], [], color=_EGO, label="its plan, a dot each second", **dots))
        keys.append(Line2D([], [], color=_EXPECTED, label="what it expects", **dots))
        if plan.guesses is not None:
            bars: dict[str, Any] = {"marker": "|", "linewidth": 0.8}
            keys.append(Line2D([], [], color=_EXPECTED, label="its guesses", **bars))
    return keys
