"""Scenes as a page's script plays them: truth, observations, and what the estimates predict."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from olne_bench.bench.report.page.tables import decimals, rounded
from olne_bench.bench.report.scenes import Place, Scene, estimated_weights, scene_of, sequences
from olne_bench.bench.report.statistics.attempts import attempts_of
from olne_bench.bench.report.study import USUAL, Study, in_table

#: Predictions on a whole page, about, and sequences of a scenario.
_MOST_PREDICTIONS, _MOST_SEQUENCES, _FEWEST_SEQUENCES = 300, 8, 2
_PLACES = 3  # millimetres, milliradians
_LANE_PLACES = 2


def scene_data(
    trials: pd.DataFrame, *, number: int = 1, study: Study = USUAL, wanted: Sequence[Place] = ()
) -> dict[str, Any]:
    """The draws and the sequences of one scenario that can be played, those ``wanted`` among them.

    ``number`` scenarios share the page. NotDrawnError if the truth is not stored or readable.
    """
    attempts = attempts_of(trials)
    paths = number * max(1, attempts.groupby(["estimator", "sensor"]).ngroups)
    most = int(np.clip(_MOST_PREDICTIONS // paths, _FEWEST_SEQUENCES, _MOST_SEQUENCES))
    places, shown = sequences(attempts, most, wanted, study)
    name = str(attempts["scenario"].iloc[0])
    draws = {seed: seed if study.is_family(name) else 0 for _, seed in places}
    scenes = {draw: scene_of(name, seed, study) for seed, draw in draws.items()}
    first = scenes[draws[places[0][1]]]
    metrics = [m.name for m in in_table(study.metrics, attempts) if not m.is_share]
    return {
        "shown": shown,
        "down": first.on_road,
        "dt": first.truth.dt,
        "weights": list(first.truth.weight_names),
        "draws": {str(draw): _draw(scene) for draw, scene in scenes.items()},
        "samples": [
            _sample(scenes[draws[seed]], attempts, (sigma, seed), metrics)
            | {"draw": str(draws[seed])}
            for sigma, seed in places
        ],
    }


def _draw(scene: Scene) -> dict[str, Any]:
    weights = scene.truth.weights
    return {
        "axes": scene.axis_names,
        "limits": scene.limits,
        "lanes": [
            {"edges": [decimals(edge, _LANE_PLACES) for edge in shape.edges], "marks": shape.marks}
            for shape in scene.lanes
        ],
        "truth": _paths(scene, scene.truth.states),
        "weights": decimals(weights / weights.sum(axis=1, keepdims=True), _PLACES),
    }


def _sample(
    scene: Scene, attempts: pd.DataFrame, place: Place, metrics: Sequence[str]
) -> dict[str, Any]:
    sigma, seed = place
    rows = attempts[(attempts["sigma"] == sigma) & (attempts["seed"] == seed)]
    return {
        "sigma": sigma,
        "seed": seed,
        # The noise is the same for all sensors and estimators, and no sensor hides positions.
        "observed": _paths(scene, scene.observed(sigma, seed)),
        "predictions": [_prediction(scene, t, metrics) for t in rows.to_dict("records")],
    }


def _prediction(scene: Scene, trial: dict[Any, Any], metrics: Sequence[str]) -> dict[str, Any]:
    states = scene.predicted(trial)
    weights = estimated_weights(trial["weights"], scene.truth)
    return {
        "estimator": trial["estimator"],
        "sensor": trial["sensor"],
        "status": trial["status"],
        "errors": {m: rounded(np.array([trial[m]], dtype=float))[0] for m in metrics},
        "paths": None if states is None else _paths(scene, states),
        "weights": None if weights is None else decimals(weights, _PLACES),
    }


def _paths(scene: Scene, states: np.ndarray) -> list[list[list[float]]]:
    """Each player's path (N, T, 2) in the scene's plane; on a road (N, T, 3), with the heading."""
    paths = states.swapaxes(0, 1)
    columns = [*scene.plane(paths), *([paths[..., 2]] if scene.on_road else [])]
    return decimals(np.stack(columns, axis=-1), _PLACES)
