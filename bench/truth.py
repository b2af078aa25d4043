"""Ground truth of scenarios, worked out once per process."""

from functools import lru_cache
from typing import Any

import numpy as np

from bench.metrics import position_error
from bench.neighbours import follow_root, neighbours
from bench.suite import ScenarioEntry
from envs.recording import Recording, record
from envs.scenarios import Scenario, get_scenario, is_family
from games.information import (
    cosine_error_limit,
    joint_weight_covariance,
    observation_sensitivity,
)
from games.nearest_root import Prediction, predict
from games.observation import View

#: Other initial states that predictions are held to, and seconds that each may take.
HELD_OUT, HELD_OUT_LIMIT = 5, 0.5

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


def held_out_error(scenario: ScenarioEntry, seed: int, weights: np.ndarray) -> float | None:
    """Mean absolute position error [m] of predictions from other initial states nearby.

    Of ``HELD_OUT`` certified equilibria, each followed from the true weights to the given ones
    (N, K) by ``bench.neighbours.follow_root``; None where no root is found for one of them.

    Raises:
        NoEquilibriumError: where there are too few certified equilibria nearby.
    """
    return _held_out_error(_key(scenario, seed), weights.tobytes())


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


@lru_cache(maxsize=64)
def _recording(key: _Key) -> Recording:
    name, options, seed = key
    return record(get_scenario(name, seed, **dict(options)))


@lru_cache(maxsize=64)
def _neighbours(key: _Key, count: int, stream: str) -> tuple[Recording, ...]:
    return neighbours(_recording(key), count, stream, seed=key[2])


@lru_cache(maxsize=16)
def _held_out_error(key: _Key, weights: bytes) -> float | None:
    errors = []
    for recording in _neighbours(key, HELD_OUT, "held out"):
        shaped = np.frombuffer(weights).reshape(recording.scenario.weights.shape)
        root = follow_root(recording, shaped, HELD_OUT_LIMIT)
        if root is None:
            return None
        errors.append(position_error(recording.states, root.states))
    return float(np.mean(errors))


@lru_cache(maxsize=128)
def _unit_limit(key: _Key, trajectories: int, view: View) -> float | None:
    recordings = (_recording(key), *_neighbours(key, trajectories - 1, "trajectories"))
    recording = recordings[0]
    sensitivities = [
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
    covariance = joint_weight_covariance(recording.scenario.game, sensitivities)
    if covariance is None:
        return None
    return cosine_error_limit(covariance, recording.scenario.weights)


@lru_cache(maxsize=8)
def _prediction(key: _Key, weights: bytes, root_iterations: int) -> Prediction:
    recording = _recording(key)
    game = recording.scenario.game
    shaped = np.frombuffer(weights).reshape(recording.scenario.weights.shape)
    return predict(
        game, shaped, recording.states, recording.controls, max_iterations=root_iterations
    )
