"""Draw the pictures of ``docs/architecture.md``: the rooms, and a trial's way through them.

python scripts/architecture_pictures.py docs/pictures
"""

import argparse
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import matplotlib

matplotlib.use("agg")

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

INK, GREY, PAPER = "#1f2328", "#57606a", "#ffffff"
SHARED, REFEREE, PLAYER = "#dbeafe", "#dcfce7", "#ffedd5"


@dataclass(frozen=True)
class Box:
    """A box: its lower left corner, its size, its title and its text."""

    x: float
    y: float
    width: float
    height: float
    title: str
    text: str = ""
    colour: str = SHARED

    @property
    def left(self) -> tuple[float, float]:
        return self.x, self.y + self.height / 2

    @property
    def right(self) -> tuple[float, float]:
        return self.x + self.width, self.y + self.height / 2

    @property
    def top(self) -> tuple[float, float]:
        return self.x + self.width / 2, self.y + self.height

    @property
    def bottom(self) -> tuple[float, float]:
        return self.x + self.width / 2, self.y


def rooms() -> Figure:
    """Packages and the rooms of ``bench``; an arrow points to what is imported."""
    figure, axes = _canvas(9.6, 5.4)
    envs = Box(0.3, 1.9, 2.7, 1.0, "envs", "scenarios, worlds, sensors,\nrecordings, traffic")
    estimators = Box(3.4, 1.9, 2.2, 1.0, "estimators", "protocol, one file\nper estimator")
    games = Box(
        0.3, 0.3, 5.3, 1.0, "games", "motion models, cost terms, equilibria, views, information"
    )
    names = {
        "commands": "olne-bench",
        "report": "tables, statistics, figures, page",
        "run": "processes, cluster, store",
        "judge": "truth, observation, metrics",
        "plan": "suites, trials, fingerprints",
        "process": "child processes, sandbox",
    }
    axes.add_patch(_patch(Box(6.1, 0.3, 3.2, 4.8, "", colour="#f6f8fa")))
    axes.text(7.7, 4.82, "bench", ha="center", va="center", weight="bold", color=INK, fontsize=11)
    stack = [
        Box(6.3, 3.95 - 0.71 * k, 2.8, 0.58, name, text, REFEREE)
        for k, (name, text) in enumerate(names.items())
    ]
    for box in (envs, estimators, games, *stack):
        _draw(axes, box)
    for above, below in pairwise(stack):
        _arrow(axes, above.bottom, below.top)
    _arrow(axes, (1.65, 1.9), (1.65, 1.3))
    _arrow(axes, (4.5, 1.9), (4.5, 1.3))
    axes.text(
        3.0, 4.3, "An arrow points to what is imported.\nbench imports from all three packages.",
        ha="center", color=GREY, fontsize=10,
    )  # fmt: skip
    _path(axes, [(6.1, 3.6), (1.65, 3.6), envs.top])
    _path(axes, [(6.1, 3.25), (4.5, 3.25), estimators.top])
    _arrow(axes, (6.1, 0.8), (5.6, 0.8))
    return figure


def trial() -> Figure:
    """The way of one trial, and what each process knows."""
    figure, axes = _canvas(9.6, 4.9)
    for box, title in (
        (Box(2.0, 2.55, 7.3, 1.95, "", colour=REFEREE), "referee process: knows the truth"),
        (
            Box(2.0, 0.3, 7.3, 1.45, "", colour=PLAYER),
            "player process: sandboxed, without the truth",
        ),
    ):
        axes.add_patch(_patch(box))
        axes.text(2.15, box.y + box.height - 0.2, title, ha="left", va="center", color=GREY)
    suite = Box(0.2, 2.75, 1.35, 1.0, "suite", "scenario, sensor,\nnoise, seed", PAPER)
    store = Box(0.2, 0.55, 1.35, 1.0, "store", "one row a trial;\ntables, page", PAPER)
    world = Box(2.25, 2.75, 1.9, 1.0, "world", "plays the certified\nequilibrium", PAPER)
    sensor = Box(4.55, 2.75, 1.9, 1.0, "sensor", "view, noise, gaps", PAPER)
    judge = Box(6.95, 2.75, 2.1, 1.0, "judge", "predicts, compares with\nthe truth", PAPER)
    estimator = Box(4.3, 0.45, 2.4, 0.85, "estimator", "built in or a plugin", PAPER)
    for box in (suite, store, world, sensor, judge, estimator):
        _draw(axes, box)
    _arrow(axes, suite.right, world.left)
    _arrow(axes, world.right, sensor.left)
    _arrow(axes, sensor.bottom, estimator.top)
    axes.text(5.4, 2.15, "Problem, Observation", ha="right", va="center", color=INK, fontsize=9)
    _path(axes, [estimator.right, (8.0, 0.875), judge.bottom])
    axes.text(7.85, 2.15, "weights, as plain data", ha="right", va="center", color=INK, fontsize=9)
    _path(axes, [(8.0, 3.75), (8.0, 4.75), (0.05, 4.75), (0.05, 1.05), store.left])
    axes.text(4.4, 4.63, "metrics: a row", ha="center", va="top", color=INK, fontsize=9)
    return figure


def _canvas(width: float, height: float) -> tuple[Figure, Axes]:
    figure = plt.figure(figsize=(width, height), facecolor=PAPER)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, width), ylim=(0, height), aspect="equal")
    axes.axis("off")
    return figure, axes


def _patch(box: Box) -> FancyBboxPatch:
    return FancyBboxPatch(
        (box.x, box.y), box.width, box.height, boxstyle="round,pad=0,rounding_size=0.08",
        facecolor=box.colour, edgecolor=GREY, linewidth=1,
    )  # fmt: skip


def _draw(axes: Axes, box: Box) -> None:
    axes.add_patch(_patch(box))
    middle, lines = box.y + box.height / 2, box.text.count("\n") + 1
    rise = 0.1 * lines if box.text else 0
    axes.text(
        box.top[0], middle + rise, box.title,
        ha="center", va="center", weight="bold", color=INK, fontsize=10,
    )  # fmt: skip
    axes.text(
        box.top[0], middle + rise - 0.12, box.text, ha="center", va="top", color=GREY, fontsize=8.5
    )


def _arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float]) -> None:
    axes.add_patch(
        FancyArrowPatch(start, end, arrowstyle="-|>", mutation_scale=12, color=INK, linewidth=1.2)
    )


def _path(axes: Axes, corners: list[tuple[float, float]]) -> None:
    """A line with corners that ends in an arrow."""
    axes.plot(*zip(*corners[:-1], strict=True), color=INK, linewidth=1.2)
    _arrow(axes, corners[-2], corners[-1])


def main() -> None:
    """Write both pictures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="folder for rooms.svg and trial.svg")
    folder = parser.parse_args().folder
    with plt.rc_context({"svg.hashsalt": "architecture"}):
        for name, draw in (("rooms", rooms), ("trial", trial)):
            draw().savefig(folder / f"{name}.svg", metadata={"Date": None})


if __name__ == "__main__":
    main()
