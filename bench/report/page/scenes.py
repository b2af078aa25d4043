"""Trajectories for the page: truth, observations, and what the estimates predict."""

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from olne_bench.bench.report.figures.scene import Scene, scene_of
from olne_bench.bench.report.figures.telling import telling_level
from olne_bench.bench.report.measures import in_table
from olne_bench.bench.report.page.numbers import decimals, rounded
from olne_bench.bench.report.statistics.attempts import attempts_of
from olne_bench.bench.report.study import USUAL, Study

if TYPE_CHECKING:
    from olne_bench.envs.road_shapes import LaneShape

#: Coordinates drawn and predictions made, about, for the whole page; most sequences of a bundle.
_MOST_COORDINATES = 140_000
_MOST_PREDICTIONS = 240
_MOST_SEQUENCES = 12
_FEWEST_SEQUENCES = 4
_OTHER_LEVELS = 3  # noise levels besides the bundle's that can be played
_OTHER_SEEDS = 1
_PLACES = 3  # millimetres, milliradians
_LANE_PLACES = 2


def scene_data(trials: pd.DataFrame, *, number: int, study: Study = USUAL) -> dict[str, Any]:
    """Truth and sample trials of one scenario.

    A bundle of sequences at the noise level at which methods differ most, and a few at other
    levels. Predictions are made again (``bench.report.predicted_motion``).

    Args:
        trials: of one scenario.
        number: of scenarios that share the page.
        study: of the run.

    Raises:
        NotDrawnError: where it cannot be played here.
    """
    attempts = attempts_of(trials)
    scene = scene_of(attempts, study)
    steps, players, _ = scene.recording.states.shape
    paths = 1 + attempts.groupby(["estimator", "sensor"]).ngroups
    most = min(_MOST_COORDINATES // (2 * steps * players), _MOST_PREDICTIONS) // (number * paths)
    bundle = telling_level(scene.trials)
    chosen = _chosen(scene, bundle, int(np.clip(most, _FEWEST_SEQUENCES, _MOST_SEQUENCES)))
    names = scene.recording.scenario.game.dynamics.state_names
    return {
        "axes": [names[axis] for axis in scene.axes_order],
        "limits": scene.limits,
        "down": scene.on_road,
        "lanes": [_lane(shape) for shape in scene.lanes],
        "dt": scene.recording.scenario.game.dt,
        "truth": _paths(scene, scene.recording.states),
        "bundle": bundle,
        "samples": [_sample(scene, *one, study) for one in chosen],
    }


def _chosen(scene: Scene, bundle: float, sequences: int) -> list[tuple[float, int]]:
    """Noise levels and seeds to show, those of the bundle first."""
    trials = scene.trials
    levels = np.sort(trials.loc[trials["sigma"] != bundle, "sigma"].unique())
    picked = np.linspace(0, len(levels) - 1, min(_OTHER_LEVELS, len(levels))).round().astype(int)
    wanted = [(bundle, sequences), *((level, _OTHER_SEEDS) for level in levels[picked][::-1])]
    return [
        (float(sigma), int(seed))
        for sigma, most in wanted
        for seed in sorted(trials.loc[trials["sigma"] == sigma, "seed"].unique())[:most]
    ]


def _sample(scene: Scene, sigma: float, seed: int, study: Study) -> dict[str, Any]:
    trials = scene.trials
    rows = trials[(trials["sigma"] == sigma) & (trials["seed"] == seed)]
    # All sensors and estimators meet the same noise, and none hides positions.
    metrics = [m for m in in_table(study.metrics, trials) if not m.is_share]
    return {
        "sigma": sigma,
        "seed": seed,
        "observed": _paths(scene, scene.observed(sigma, seed)),
        "predictions": [
            {
                "estimator": trial["estimator"],
                "sensor": trial["sensor"],
                "status": trial["status"],
                "errors": {
                    metric.name: rounded(np.array([trial[metric.name]], dtype=float))[0]
                    for metric in metrics
                },
                "paths": _predicted(scene, trial),
            }
            for trial in rows.to_dict("records")
        ],
    }


def _predicted(scene: Scene, trial: dict[Any, Any]) -> list[list[list[float]]] | None:
    states = scene.predicted(trial)
    return None if states is None else _paths(scene, states)


def _lane(shape: "LaneShape") -> dict[str, Any]:
    edges = [decimals(edge, _LANE_PLACES) for edge in shape.edges]
    return {"edges": edges, "marks": shape.marks}


def _paths(scene: Scene, states: np.ndarray) -> list[list[list[float]]]:
    """Each player's path (N, T, 2) in the plane of the scene; cars have a third entry, heading."""
    paths = states.swapaxes(0, 1)
    columns = [*scene.plane(paths), *([paths[..., 2]] if scene.on_road else [])]
    return decimals(np.stack(columns, axis=-1), _PLACES)
