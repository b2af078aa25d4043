"""Ground truth of scenarios, worked out once per process."""

from functools import lru_cache
from typing import Any

import numpy as np

from bench.suite import ScenarioEntry
from envs.recording import Recording, record
from envs.scenarios import Scenario, get_scenario, is_family
from games.information import cosine_error_limit, weight_covariance
from games.nearest_root import Prediction, predict
from games.observation import View

_Key = tuple[str, tuple[tuple[str, Any], ...], int]


def true_recording(scenario: ScenarioEntry, seed: int) -> Recording:
    """The recording of a scenario's draw.

    Raises:
        NoEquilibriumError: where no certified equilibrium was found.
    """
    return _recording(_key(scenario, seed))


def unit_cosine_limit(scenario: ScenarioEntry, seed: int, view: View) -> float | None:
    """Expected cosine error of an efficient estimator at sigma = 1; None if not identifiable.

    To be multiplied by sigma^2 (``games.information.cosine_error_limit``).
    """
    return _unit_limit(_key(scenario, seed), view)


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


@lru_cache(maxsize=128)
def _unit_limit(key: _Key, view: View) -> float | None:
    recording = _recording(key)
    covariance = weight_covariance(
        recording.scenario.game,
        view,
        recording.states,
        recording.controls,
        recording.costates,
        recording.scenario.weights,
        noise_scale=observed_noise_scale(recording.scenario, view),
    )
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
