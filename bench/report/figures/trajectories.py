"""Bundles of predicted trajectories, at a noise level at which methods differ visibly."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from olne_bench.bench.report.figures import style
from olne_bench.bench.report.figures.panels import scene_panels
from olne_bench.bench.report.figures.scene import Scene, scene_of
from olne_bench.bench.report.figures.series import Series, contenders, sensors_in, split
from olne_bench.bench.report.figures.telling import telling_level
from olne_bench.bench.report.study import USUAL, Study
from olne_bench.envs.worlds.scene import player_colour

#: Most sequences in one panel, as in the paper.
MOST_SEQUENCES = 40

_COLUMNS = 3
_FEW = 4  # sequences up to which lines are strong
_TRUTH_STYLE = (0, (3, 1.5))


def draw(trials: pd.DataFrame, study: Study = USUAL) -> Figure:
    """Truth and observations, then one panel per series.

    Predictions are computed again from the estimated weights and the true initial state
    (``bench.report.predicted_motion``).

    Raises:
        NotDrawnError: as ``scene_of``, and if weights do not fit the scenario.
    """
    scene = scene_of(trials, study)
    sigma = telling_level(scene.trials)
    seeds = sorted(scene.trials.loc[scene.trials["sigma"] == sigma, "seed"].unique())
    seeds = seeds[:MOST_SEQUENCES]
    shown = scene.trials["seed"].isin(seeds) & (scene.trials["sigma"] == sigma)
    series = contenders(split(scene.trials[shown], study))

    figure, (first, *panels) = scene_panels(
        scene, [(0, 0), *_places(scene, series)], margin=(0.3, 0.9)
    )
    _observations(first, scene, sigma, seeds)
    for axes, s in zip(panels, series, strict=True):
        _predictions(axes, scene, s)
    figure.suptitle(
        f"{trials['scenario'].iloc[0]}: predicted trajectories at σ = {sigma:g}{scene.stretch_note}"
    )
    style.legend_below(figure, legend_entries(scene))
    return figure


def _places(scene: Scene, series: Sequence[Series]) -> list[tuple[int, int]]:
    """A row per estimator and a column per sensor; a single column if the scene is wide.

    With a single sensor, the panels follow each other.
    """
    if scene.is_wide:
        return [(1 + k, 0) for k in range(len(series))]
    sensors = sensors_in(pd.concat([s.trials for s in series]))
    if len(sensors) == 1:
        return [divmod(1 + k, _COLUMNS) for k in range(len(series))]
    estimators = style.estimator_order([s.estimator for s in series])
    return [(estimators.index(s.estimator), 1 + sensors.index(s.sensor)) for s in series]


def _observations(axes: Axes, scene: Scene, sigma: float, seeds: Sequence[int]) -> None:
    # The noise is the same for all sensors and estimators, and no sensor hides positions.
    for seed in seeds:
        draw_bundle(
            axes,
            scene,
            scene.observed(sigma, int(seed)),
            marker=".",
            markersize=2,
            linestyle="none",
            alpha=0.4,
        )
    draw_truth(axes, scene)
    axes.set_title(f"Truth and {len(seeds)} observed sequence{'s' * (len(seeds) != 1)}")


def _predictions(axes: Axes, scene: Scene, series: Series) -> None:
    predicted = [scene.predicted(trial) for trial in series.trials.to_dict("records")]
    found = [states for states in predicted if states is not None]
    for states in found:
        few = len(found) <= _FEW
        draw_bundle(axes, scene, states, linewidth=1.4 if few else 0.8, alpha=0.9 if few else 0.45)
        for i, state in enumerate(states[-1]):
            scene.draw_car(axes, state, player_colour(i), filled=False)
    draw_truth(axes, scene)
    failed = int(series.published_failed.sum())
    without = len(predicted) - len(found) - failed
    parts = [
        style.printable(series.estimator),
        f"{style.printable(series.sensor)}, {failed} of {len(series.trials)} failed",
        *[f"{without} not drawn"] * (without > 0),
    ]
    axes.set_title((", " if scene.is_wide else "\n").join(parts))


def draw_bundle(axes: Axes, scene: Scene, states: np.ndarray, **line: Any) -> None:
    """Draw the path of each player in states (T, N, n), in the player's colour."""
    for i in range(states.shape[1]):
        axes.plot(*scene.plane(states[:, i]), color=player_colour(i), rasterized=True, **line)


def draw_truth(axes: Axes, scene: Scene) -> None:
    """Draw the true paths, numbered where they start; on a road with the cars at their ends."""
    states = scene.recording.states
    for i in range(states.shape[1]):
        axes.plot(*scene.plane(states[:, i]), color="black", linewidth=1, linestyle=_TRUTH_STYLE)
        scene.draw_car(axes, states[0, i], "black", label=str(i + 1))
        if scene.on_road:
            scene.draw_car(axes, states[-1, i], "black", filled=False)


def legend_entries(scene: Scene) -> list[tuple[Artist, str]]:
    """Entries of a legend: the truth, and each player's colour."""
    truth = Line2D([], [], color="black", linewidth=1, linestyle=_TRUTH_STYLE, markersize=4)
    truth.set_marker("s" if scene.on_road else "o")
    truth.set_markevery([0])
    players: list[tuple[Artist, str]] = [
        (Line2D([], [], color=player_colour(i)), f"player {i + 1}")
        for i in range(scene.recording.states.shape[1])
    ]
    return [(truth, "truth, numbered where it starts"), *players]
