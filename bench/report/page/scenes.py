"""Trajectories for the page: truth, observations, and what the estimates predict."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from olne_bench.bench.report.figures.scene import Scene, scene_of
from olne_bench.bench.report.figures.telling import telling_level
from olne_bench.bench.report.measures import in_table
from olne_bench.bench.report.page.numbers import decimals, rounded
from olne_bench.bench.report.predicted_motion import estimated_weights
from olne_bench.bench.report.statistics.attempts import attempts_of
from olne_bench.bench.report.study import USUAL, Study

if TYPE_CHECKING:
    from olne_bench.envs.roads.road_shapes import LaneShape

#: Approximate number of coordinates and of predictions on the whole page.
_MOST_COORDINATES = 160_000
_MOST_PREDICTIONS = 360
#: Number of sequences of a scenario that can be played, and of those in the bundle of one level.
_FEWEST_SEQUENCES, _MOST_SEQUENCES = 6, 60
_MOST_IN_BUNDLE = 10
_MOST_DRAWS = 4  # of a family: each has its own truth and road
_PLACES = 3  # millimetres, milliradians
_LANE_PLACES = 2

#: Noise level and seed of a sequence.
Place = tuple[float, int]


def scene_data(
    trials: pd.DataFrame, *, number: int, study: Study = USUAL, wanted: Sequence[Place] = ()
) -> dict[str, Any]:
    """The truth, and the sequences of one scenario that can be played.

    These are a bundle at the noise level at which methods differ most, and others at as many levels
    as fit. Predictions are computed again (``bench.report.predicted_motion``).

    Args:
        trials: trials of one scenario.
        number: number of scenarios that share the page.
        study: study of the run.
        wanted: sequences that must be among them, if the scenario has them.

    Raises:
        NotDrawnError: if the scenario cannot be played here.
    """
    attempts = attempts_of(trials)
    scene = scene_of(attempts, study)
    steps, players, _ = scene.recording.states.shape
    paths = 1 + attempts.groupby(["estimator", "sensor"]).ngroups
    most = min(_MOST_COORDINATES // (2 * steps * players), _MOST_PREDICTIONS) // (number * paths)
    bundle = telling_level(scene.trials)
    chosen = _chosen(attempts, scene, bundle, most, wanted)
    draws = {_draw_of(scene, seed): scene for _, seed in chosen[:1]}
    for _, seed in chosen:
        if _draw_of(scene, seed) not in draws:
            draws[seed] = scene_of(attempts[attempts["seed"] == seed], study)
    game = scene.recording.scenario.game
    return {
        "down": scene.on_road,
        "dt": game.dt,
        "weights": list(game.weight_names),
        "draws": {str(key): _draw(one) for key, one in draws.items()},
        "bundle": bundle,
        "samples": [
            _sample(draws[_draw_of(scene, seed)], sigma, seed, study) for sigma, seed in chosen
        ],
    }


def _draw_of(scene: Scene, seed: int) -> int:
    """The number of a seed's draw; a fixed scenario has only draw 0."""
    return seed if scene.study.is_family(scene.name) else 0


def _draw(scene: Scene) -> dict[str, Any]:
    truth = scene.recording.scenario
    names = truth.game.dynamics.state_names
    weights = truth.weights / truth.weights.sum(axis=1, keepdims=True)
    return {
        "axes": [names[axis] for axis in scene.axes_order],
        "limits": scene.limits,
        "lanes": [_lane(shape) for shape in scene.lanes],
        "truth": _paths(scene, scene.recording.states),
        "weights": decimals(weights, _PLACES),
    }


def _chosen(
    attempts: pd.DataFrame, scene: Scene, bundle: float, most: int, wanted: Sequence[Place]
) -> list[Place]:
    """Sequences to show: those of the bundle, the wanted ones, then one seed of each level, ..."""
    most = int(np.clip(most, _FEWEST_SEQUENCES, _MOST_SEQUENCES))
    places = attempts[["sigma", "seed"]].drop_duplicates().astype({"sigma": float, "seed": int})
    own = set(scene.trials["seed"])
    # Seeds of the scene come first: in a family these are one draw, whose truth is known already.
    order = places.assign(other=~places["seed"].isin(own)).sort_values(["other", "seed"])
    order["turn"] = order.groupby("sigma").cumcount()
    order = order.sort_values(["turn", "sigma"], ascending=[True, False])
    known = list(order[["sigma", "seed"]].itertuples(index=False, name=None))
    first = [place for place in known if place[0] == bundle and place[1] in own]
    few = first[: max(1, min(_MOST_IN_BUNDLE, most // 2))]
    asked = [place for place in wanted if place in known]
    ranked = dict.fromkeys([*few, *asked, *known])
    drawn = dict.fromkeys(_draw_of(scene, seed) for _, seed in [*few, *asked, *known])
    kept = {*list(drawn)[:_MOST_DRAWS], *(_draw_of(scene, seed) for _, seed in asked)}
    playable = [place for place in ranked if _draw_of(scene, place[1]) in kept]
    return playable[: max(most, len(few) + len(asked))]


def _sample(scene: Scene, sigma: float, seed: int, study: Study) -> dict[str, Any]:
    trials = scene.trials
    rows = trials[(trials["sigma"] == sigma) & (trials["seed"] == seed)]
    # The noise is the same for all sensors and estimators, and no sensor hides positions.
    metrics = [m for m in in_table(study.metrics, trials) if not m.is_share]
    return {
        "sigma": sigma,
        "seed": seed,
        "draw": str(_draw_of(scene, seed)),
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
                "weights": _estimated(scene, trial),
            }
            for trial in rows.to_dict("records")
        ],
    }


def _predicted(scene: Scene, trial: dict[Any, Any]) -> list[list[list[float]]] | None:
    states = scene.predicted(trial)
    return None if states is None else _paths(scene, states)


def _estimated(scene: Scene, trial: dict[Any, Any]) -> list[list[float]] | None:
    weights = estimated_weights(trial["weights"], scene.recording.scenario.game)
    return None if weights is None else decimals(weights, _PLACES)


def _lane(shape: "LaneShape") -> dict[str, Any]:
    edges = [decimals(edge, _LANE_PLACES) for edge in shape.edges]
    return {"edges": edges, "marks": shape.marks}


def _paths(scene: Scene, states: np.ndarray) -> list[list[list[float]]]:
    """Each player's path (N, T, 2) in the scene's plane; on a road (N, T, 3), with the heading."""
    paths = states.swapaxes(0, 1)
    columns = [*scene.plane(paths), *([paths[..., 2]] if scene.on_road else [])]
    return decimals(np.stack(columns, axis=-1), _PLACES)
