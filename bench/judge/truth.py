"""Ground truth of scenarios, worked out once per process."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from olne_bench.bench.judge.metrics.judged import HeldOut
from olne_bench.bench.judge.nearby_starts import follow_start, neighbours
from olne_bench.bench.plan.suite import ScenarioEntry
from olne_bench.envs.recording import NoEquilibriumError, Recording, record
from olne_bench.envs.scenarios import Scenario, get_scenario, is_family
from olne_bench.games.information import (
    cosine_error_limit,
    joint_weight_covariance,
    observation_sensitivity,
)
from olne_bench.games.nearest_root import Prediction, predict
from olne_bench.games.observation import View

#: Other initial states that predictions are held to.
HELD_OUT = 5

_Key = tuple[str, tuple[tuple[str, Any], ...], int]


def true_recording(scenario: ScenarioEntry, seed: int) -> Recording:
    """The recording of a scenario's draw.

    Raises:
        NoEquilibriumError: where no certified equilibrium was found.
    """
    return _recording(_key(scenario, seed))


def true_recordings(scenario: ScenarioEntry, seed: int) -> tuple[Recording, ...]:
    """The recording of a scenario's draw and, where it shows several trajectories, the others.

    Raises:
        NoEquilibriumError: where no certified equilibrium was found.
    """
    key = _key(scenario, seed)
    first = _recording(key)
    return (first, *_neighbours(key, scenario.trajectories - 1, "trajectories"))


def held_out_predictions(
    scenario: ScenarioEntry, seed: int, weights: np.ndarray, root_iterations: int
) -> tuple[HeldOut, ...] | None:
    """Predictions from other initial states nearby, beside the truth there.

    There are ``HELD_OUT`` of them, each with a certified equilibrium at the true weights. The
    prediction at the given weights (N, K) from the draw's own initial state
    (``predict_from_start``) is followed to each (``nearby_starts.follow_start``).

    Returns:
        None where there are too few certified equilibria nearby, no prediction to follow, or no
        root at one of the states.
    """
    try:
        return _held_out(_key(scenario, seed), weights.tobytes(), root_iterations)
    except NoEquilibriumError:  # nothing near this draw to predict
        return None


def unit_cosine_limit(scenario: ScenarioEntry, seed: int, view: View) -> float | None:
    """Expected cosine error of an efficient estimator at sigma = 1; None if not identifiable.

    To be multiplied by sigma^2 (``games.information.cosine_error_limit``).
    """
    return _unit_limit(_key(scenario, seed), scenario.trajectories, view)


def predict_from_start(
    scenario: ScenarioEntry, seed: int, weights: np.ndarray, root_iterations: int
) -> Prediction:
    """The forward game at weights (N, K), from a draw's true initial state.

    The last ones are kept, as some estimators return the same weights again and again.
    ``root_iterations`` are those of ``Suite``.
    """
    return _prediction(_key(scenario, seed), weights.tobytes(), root_iterations)


def _key(scenario: ScenarioEntry, seed: int) -> _Key:
    options = tuple(sorted(scenario.options.items()))
    return scenario.name, options, seed if is_family(scenario.name) else 0


def observed_noise_scale(scenario: Scenario, view: View) -> np.ndarray:
    """Relative standard deviations (d,) of the noise on what a view shows."""
    return view.noise_scale(np.array(scenario.noise_scale), scenario.game.dynamics)


def sensitivities_of(recordings: Sequence[Recording], view: View) -> list[np.ndarray]:
    """Of each recording's observations, over their noise (``observation_sensitivity``)."""
    return [
        observation_sensitivity(
            one.scenario.game,
            view,
            one.states,
            one.controls,
            one.costates,
            one.scenario.weights,
            noise_scale=observed_noise_scale(one.scenario, view),
        )
        for one in recordings
    ]


@lru_cache(maxsize=64)
def _recording(key: _Key) -> Recording:
    name, options, seed = key
    return record(get_scenario(name, seed, **dict(options)))


@lru_cache(maxsize=64)
def _neighbours(key: _Key, count: int, stream: str) -> tuple[Recording, ...]:
    return neighbours(_recording(key), count, stream, seed=key[2])


@lru_cache(maxsize=16)
def _held_out(key: _Key, weights: bytes, root_iterations: int) -> tuple[HeldOut, ...] | None:
    recordings = _neighbours(key, HELD_OUT, "held out")
    known = _prediction(key, weights, root_iterations).root
    if known is None:
        return None
    shaped = np.frombuffer(weights).reshape(recordings[0].scenario.weights.shape)
    roots = follow_start(recordings, shaped, known)
    if len(roots) < len(recordings):
        return None
    pairs = zip(recordings, roots, strict=True)
    return tuple(HeldOut(one.states, root.states) for one, root in pairs)


@lru_cache(maxsize=128)
def _unit_limit(key: _Key, trajectories: int, view: View) -> float | None:
    recordings = (_recording(key), *_neighbours(key, trajectories - 1, "trajectories"))
    recording = recordings[0]
    sensitivities = sensitivities_of(recordings, view)
    covariance = joint_weight_covariance(recording.scenario.game, sensitivities)
    if covariance is None:
        return None
    return cosine_error_limit(covariance, recording.scenario.weights)


@lru_cache(maxsize=8)
def _prediction(key: _Key, weights: bytes, root_iterations: int) -> Prediction:
    recording = _recording(key)
    scenario = recording.scenario
    shaped = np.frombuffer(weights).reshape(scenario.weights.shape)
    return predict(
        scenario.game, shaped, recording.root, scenario.weights, max_iterations=root_iterations
    )
