"""Draw the picture that explains a weight: one lane change, two drivers.

    python scripts/weight_picture.py docs/pictures/weight.svg

Both drivers start in the same place and have the same target speed. Only their weights differ. The
motions are open-loop Nash equilibria of the game with the other car.
"""

from pathlib import Path
from typing import NamedTuple

import shared
import matplotlib

matplotlib.use("agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch
from matplotlib.transforms import Affine2D

from olne_bench.envs.roads.highway_roads import DT, road_network, route
from olne_bench.envs.roads.road_scenario import FAST, Driver, driving_scenario, rejection
from olne_bench.games.solve.olne import Equilibrium, solve_olne

LANE_WIDTH = 4.0  # [m], HighwayEnv's
ROAD = (53.0, 172.0)  # [m], the part that is shown
CAR_SIZE = (5.0, 2.0)  # [m]
OTHER_WEIGHTS = (0.25, 0.25, 0.25, 0.25)
SHOWN = (0, 3, 6, 9)  # steps
GREY, INK, PAPER = "#6b6b6b", "#1f2328", "#ffffff"


class Subject(NamedTuple):
    """One driver of the picture: its name, its weights (4,) and its colour."""

    name: str
    weights: tuple[float, float, float, float]
    colour: str


SUBJECTS = (
    Subject("Driver A", (0.1, 0.6, 0.1, 0.2), "#0072B2"),
    Subject("Driver B", (0.7, 0.1, 0.1, 0.1), "#D55E00"),
)
#: Cost terms in the order of the game's weights: their meaning and formula.
TERMS = (
    ("keep away from others", r"$\theta_1\;\sum_j -\log\,d_{ij}^2$"),
    ("drive the speed I like", r"$\theta_2\;(v - v_{target})^2$"),
    ("accelerate gently", r"$\theta_3\;a^2$"),
    ("steer gently", r"$\theta_4\;\delta^2$"),
)


def motion(subject: Subject) -> Equilibrium:
    """The equilibrium in which the subject changes lanes behind another car.

    Raises:
        RuntimeError: if HighwayEnv cannot play it, as cars collide or it is not certified.
    """
    network = road_network("highway")
    lane = route(network, ("0", "1", 1))
    drivers = [
        Driver((60.0, 2 * LANE_WIDTH, 0.0, 24.0), lane, 24.0),
        Driver((68.0, LANE_WIDTH, 0.0, 24.0), lane, 24.0),
    ]
    weights = np.array([subject.weights, OTHER_WEIGHTS])
    scenario = driving_scenario("highway", drivers, FAST, weights)
    reason = rejection(scenario)
    if reason is not None:
        raise RuntimeError(f"the motion of {subject.name} cannot be played: {reason}")
    return solve_olne(scenario.game, scenario.weights, scenario.initial_state)


def draw() -> Figure:
    """The whole picture."""
    figure = plt.figure(figsize=(9.6, 5.2), facecolor=PAPER)
    figure.text(
        0.5, 0.955, "A driver pays for four things. Its weights say how much for each.",
        ha="center", fontsize=13, color=INK, weight="bold",
    )  # fmt: skip
    for k, (words, formula) in enumerate(TERMS):
        _term(figure.add_axes((0.03 + 0.245 * k, 0.62, 0.205, 0.27)), k, words, formula)
    for row, subject in enumerate(SUBJECTS):
        _road(figure.add_axes((0.03, 0.325 - 0.3 * row, 0.94, 0.235)), subject)
    return figure


def _term(axes: Axes, index: int, words: str, formula: str) -> None:
    axes.set(xlim=(0, 1), ylim=(0, 1))
    axes.axis("off")
    axes.text(0, 0.9, words, fontsize=10.5, color=INK)
    axes.text(0, 0.63, formula, fontsize=10.5, color=GREY)
    for row, subject in enumerate(SUBJECTS):
        value, height = subject.weights[index], 0.32 - 0.26 * row
        axes.barh(height, 0.72 * value, 0.18, left=0.13, color=subject.colour)
        axes.text(0.0, height, subject.name[-1], va="center", color=subject.colour, weight="bold")
        axes.text(0.16 + 0.72 * value, height, f"{value:g}", va="center", fontsize=9, color=INK)


def _road(axes: Axes, subject: Subject) -> None:
    states = motion(subject).states
    axes.set(xlim=ROAD, ylim=(3.1 * LANE_WIDTH, -0.6 * LANE_WIDTH), aspect="equal")
    axes.axis("off")
    axes.fill_between(ROAD, LANE_WIDTH / 2, 2.5 * LANE_WIDTH, color="#e6e6e3", zorder=0)
    axes.hlines(1.5 * LANE_WIDTH, *ROAD, color="white", linestyle=(0, (8, 8)), linewidth=1.5)
    last = SHOWN[-1]
    for player, colour in ((1, GREY), (0, subject.colour)):
        axes.plot(*states[: last + 1, player, :2].T, color=colour, linewidth=1, alpha=0.6)
        for step in SHOWN:
            _car(axes, states[step, player], colour, alpha=1.0 if step == last else 0.45)
    for step in SHOWN:
        axes.text(
            states[step, 0, 0], 3.05 * LANE_WIDTH, f"{DT * step:.1f} s",
            color=subject.colour, fontsize=8.5, ha="center",
        )  # fmt: skip
    gap, speed = states[last, 1, 0] - states[last, 0, 0], states[last, 0, 3]
    axes.text(
        ROAD[0], -0.05 * LANE_WIDTH,
        f"{subject.name}: after {DT * last:.1f} s it drives {speed:.0f} m/s, "
        f"{gap:.0f} m behind the other car",
        color=subject.colour, fontsize=10.5, weight="bold",
    )  # fmt: skip


def _car(axes: Axes, state: np.ndarray, colour: str, alpha: float) -> None:
    px, py, heading, _ = state
    length, width = CAR_SIZE
    body = FancyBboxPatch(
        (-length / 2, -width / 2), length, width, boxstyle="round,pad=0,rounding_size=0.6",
        facecolor=colour, edgecolor=PAPER, linewidth=0.6, alpha=alpha, zorder=3,
    )  # fmt: skip
    body.set_transform(Affine2D().rotate(heading).translate(px, py) + axes.transData)
    axes.add_patch(body)


def main(out: Path) -> None:
    """Write the picture."""
    with plt.rc_context({"svg.hashsalt": "weight"}):
        metadata = {"Date": None} if out.suffix == ".svg" else {}
        draw().savefig(out, dpi=150, metadata=metadata)


if __name__ == "__main__":
    shared.command(main)
