"""Bundles of predicted trajectories at the largest noise level."""

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bench.figures import style
from bench.figures.scene import Scene, estimated_weights, player_colour, scene_of
from bench.figures.series import Series, contenders, split, views_in
from bench.sensor import sense
from games.nearest_root import nearest_root
from games.observation import FullView

#: Most sequences in one panel, as in the paper.
MOST_SEQUENCES = 40

_PANEL_AREA = 6.5  # [inch^2]
_WIDEST = 7.2  # [inch]


def draw(trials: pd.DataFrame) -> Figure | None:
    """Truth and observations, then one panel per series.

    Predictions are recomputed from the estimated weights: the root of the forward game nearest
    the truth, from the true initial state.
    """
    attempts = trials[trials["status"] != "skipped"]
    if attempts.empty:
        return None
    scene = scene_of(attempts)
    if scene is None:
        return None
    sigma = scene.trials["sigma"].max()
    seeds = sorted(scene.trials.loc[scene.trials["sigma"] == sigma, "seed"].unique())
    seeds = seeds[:MOST_SEQUENCES]
    shown = scene.trials["seed"].isin(seeds) & (scene.trials["sigma"] == sigma)
    series = contenders(split(scene.trials[shown]))

    figure, first, panels = _panels(scene, series)
    _observations(first, scene, sigma, seeds)
    for axes, s in zip(panels, series, strict=True):
        _predictions(axes, scene, s)
    figure.suptitle(f"{trials['scenario'].iloc[0]}: predicted trajectories at σ = {sigma:g}")
    style.legend_below(figure, _entries(scene), columns=4)
    return figure


def _panels(scene: Scene, series: Sequence[Series]) -> tuple[Figure, Axes, list[Axes]]:
    """Beside each other, a row per estimator; below each other where the scene is wide."""
    estimators = style.estimator_order([s.estimator for s in series])
    views = views_in(pd.concat([s.trials for s in series]))
    width, height = scene.extents
    if scene.is_wide:
        places = [(1 + k, 0) for k in range(len(series))]
        rows, columns = 1 + len(series), 1
        panel_width = _WIDEST
    else:
        places = [(estimators.index(s.estimator), 1 + views.index(s.view)) for s in series]
        rows, columns = len(estimators), 1 + len(views)
        panel_width = math.sqrt(_PANEL_AREA * width / height)
    panel_height = panel_width * height / width
    figure = Figure(figsize=(columns * (panel_width + 0.25), rows * (panel_height + 0.4) + 1.2))
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    panels = [grid[place] for place in places]
    for axes in {*grid.ravel()} - {grid[0, 0], *panels}:
        axes.set_axis_off()
    return figure, grid[0, 0], panels


def _observations(axes: Axes, scene: Scene, sigma: float, seeds: Sequence[int]) -> None:
    # All views and estimators meet the same noise, and none hides positions.
    for seed in seeds:
        positions = sense(scene.recording, FullView(), sigma, int(seed)).y
        _bundle(axes, scene, positions, marker=".", markersize=1.5, linewidth=0.3, alpha=0.35)
    _truth(axes, scene)
    axes.set_title(f"Truth and {len(seeds)} observed sequence{'s' * (len(seeds) != 1)}")


def _predictions(axes: Axes, scene: Scene, series: Series) -> None:
    predicted = [p for p in (_predict(row, scene) for row in series.trials.to_dict("records"))]
    found = [states for states in predicted if states is not None]
    for states in found:
        _bundle(axes, scene, states, linewidth=0.8, alpha=0.45)
    _truth(axes, scene)
    title = f"{style.printable(series.estimator)}\n{style.printable(series.view)} view"
    axes.set_title(f"{title}, {len(predicted) - len(found)} of {len(predicted)} failed")


def _predict(trial: dict, scene: Scene) -> np.ndarray | None:
    """States of the forward game at the trial's estimate; None for a failure."""
    weights = estimated_weights(trial["weights"], scene)
    if trial["status"] != "ok" or weights is None:
        return None
    recording = scene.recording
    root = nearest_root(recording.scenario.game, weights, recording.states, recording.controls)
    return None if root is None else root.states


def _bundle(axes: Axes, scene: Scene, states: np.ndarray, **line) -> None:  # type: ignore[no-untyped-def]
    for i in range(states.shape[1]):
        axes.plot(*scene.plane(states[:, i]), color=player_colour(i), rasterized=True, **line)


def _truth(axes: Axes, scene: Scene) -> None:
    states = scene.recording.states
    for i in range(states.shape[1]):
        axes.plot(*scene.plane(states[:, i]), color="black", linewidth=1, linestyle=(0, (3, 1.5)))
        axes.plot(*scene.plane(states[0, i]), color="black", marker="o", markersize=4)
    scene.frame(axes)


def _entries(scene: Scene) -> list[tuple[Artist, str]]:
    truth = Line2D([], [], color="black", linewidth=1, linestyle=(0, (3, 1.5)), marker="o")
    truth.set_markevery([0])
    players: list[tuple[Artist, str]] = [
        (Line2D([], [], color=player_colour(i)), f"player {i + 1}")
        for i in range(scene.recording.states.shape[1])
    ]
    return [(truth, "truth, from its start"), *players]
