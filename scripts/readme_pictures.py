"""Make the film and the chart of README: one road as two estimators see it, and who is how far off.

    python scripts/readme_pictures.py docs/pictures

Writes ``film.gif``, a draw of a road with its noisy samples and what two estimators predict, and
``scores.svg``, from ``results/roads/scores.csv``.
"""

from pathlib import Path

import shared
import matplotlib

matplotlib.use("agg")

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon
from PIL import Image

import olne_bench as ob
from olne_bench.envs.roads.road_shapes import lane_shapes
from olne_bench.envs.worlds.scene import car_outline

SCORES = Path(__file__).parents[1] / "results/roads/scores.csv"
ROADS = ("highway", "merge", "two_way", "roundabout", "intersection")
ROAD, SEED, SIGMA = "merge", 0, 0.5  # a name, a draw, a noise level [m]
SIGHT, SIDE = 50.0, 4.0  # [m] to see before and behind the cars; beside the road
STEP_MS, LAST_MS = 200, 1600  # [ms] a frame is shown
TRUTH, SEEN, FIT, BASELINE = "#3b4048", "#B58900", "#0072B2", "#D55E00"
ROWS = (
    ("What was seen", "", SEEN),
    ("map", "map", FIT),
    ("kkt_residual", "kkt_residual", BASELINE),
)


def main(out: Path) -> None:
    """Write both pictures into a folder."""
    film(out / "film.gif")
    figure = chart(pd.read_csv(SCORES))
    figure.savefig(out / "scores.svg", metadata={"Date": None})


def film(path: Path) -> None:
    """Write the film: one frame a step of the motion, as GIF."""
    scenario = ob.scenario(ROAD, SEED, num_players=3, weights="temperaments")
    problem, seen = ob.observe(scenario, sensor="full", sigma=SIGMA)
    truth = ob.solve_olne(scenario.game, scenario.weights, scenario.initial_state).states
    found = [ob.estimate(problem, seen, name).predict().states for _, name, _ in ROWS[1:]]
    shown = [seen.y, *found]
    frames = [_frame(truth, shown, t) for t in range(len(truth))]
    palette = frames[-1].quantize(64)
    small = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    times = [STEP_MS] * (len(small) - 1) + [LAST_MS]
    small[0].save(
        path, save_all=True, append_images=small[1:], duration=times, loop=0, optimize=True
    )


def _frame(truth: np.ndarray, shown: list[np.ndarray], t: int) -> Image.Image:
    """The rows of the film at a step: truth (T, N, 4) below samples and predictions (T, N, d)."""
    figure, rows = plt.subplots(len(ROWS), 1, figsize=(7.6, 5.0), dpi=100)
    figure.subplots_adjust(left=0.01, right=0.99, top=0.94, bottom=0.08, hspace=0.22)
    middle = (truth[t, :, 0].min() + truth[t, :, 0].max()) / 2
    ends = truth[..., 1].min() - SIDE, truth[..., 1].max() + SIDE
    for axes, (title, name, colour), states in zip(rows, ROWS, shown, strict=True):
        _road(axes, (middle - SIGHT, middle + SIGHT), ends)
        for i in range(truth.shape[1]):
            _car(axes, truth[t, i], TRUTH, filled=True)
            if name:
                _car(axes, states[t, i], colour, filled=False)
                axes.plot(*states[: t + 1, i, :2].T, color=colour, linewidth=1.6)
            else:
                axes.plot(*states[: t + 1, i, :2].T, ".", color=colour, markersize=7)
        if name:
            off = np.linalg.norm(states[t, :, :2] - truth[t, :, :2], axis=-1).mean()
            title = f"{title} predicts: {off:.1f} m off"
        axes.set_title(title, loc="left", fontsize=12, color=colour, fontweight="bold", pad=3)
    keys = [
        Patch(facecolor=TRUTH, label="true car"),
        Line2D([], [], color=SEEN, marker="o", linestyle="", label=f"samples, noise {SIGMA:g} m"),
        Patch(facecolor="none", edgecolor="#767b84", linewidth=2, label="predicted car"),
    ]
    figure.legend(handles=keys, loc="lower center", ncols=3, frameon=False, fontsize=11)
    figure.canvas.draw()
    image = Image.fromarray(np.asarray(figure.canvas.buffer_rgba())[..., :3])  # type: ignore[attr-defined]
    plt.close(figure)
    return image


def _road(axes: Axes, along: tuple[float, float], across: tuple[float, float]) -> None:
    """The lanes of the road between two places along it and two across [m]."""
    low, high = np.array([along[0] - 5, -20.0]), np.array([along[1] + 5, 20.0])
    lanes = [np.vstack([s.edges[0], s.edges[1][::-1]]) for s in lane_shapes(ROAD, low, high)]
    axes.add_collection(PolyCollection(lanes, facecolor="#E3E5E8", edgecolor="white", zorder=0.5))
    axes.set(xlim=along, ylim=across[::-1], aspect="equal", xticks=[], yticks=[])
    axes.spines[:].set_visible(False)


def _car(axes: Axes, state: np.ndarray, colour: str, *, filled: bool) -> None:
    """A car at a state (4,): a filled one, or only its outline."""
    face = colour if filled else "none"
    outline = car_outline(state)
    axes.add_patch(Polygon(outline, facecolor=face, edgecolor=colour, linewidth=2, zorder=3))


def chart(scores: pd.DataFrame) -> Figure:
    """Scores on five roads that are fully seen, geometric means, best first; a guess is grey."""
    full = (scores["error"] == "position_error") & (scores["sensor"] == "full")
    rows = scores[full & scores["scenario"].isin(ROADS) & scores["sigma"].isna()]
    logs = np.log(rows.set_index("estimator")["score"]).groupby(level=0)
    means = np.exp(logs.mean()).sort_values()
    figure, axes = plt.subplots(figsize=(7.6, 3.4), layout="constrained")
    names = means.index.tolist()
    colours = ["#8a8f98" if name == "uniform" else FIT for name in names]
    axes.barh(names, means, color=colours)
    labels = {"uniform": "uniform (a guess)"}
    axes.set_yticks(range(len(names)), [labels.get(name, name) for name in names])
    for place, score in enumerate(means):
        axes.text(score, place, f" {score:.2g}", va="center")
    axes.invert_yaxis()
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_xlabel("error of predicted positions / that of the paper's method (kkt_constrained)")
    return figure


if __name__ == "__main__":
    shared.command(main)
