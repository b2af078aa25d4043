"""Predictions of stored trials, made again for pictures.

A store keeps of each prediction its error alone, so the same motion is looked for again, cheapest
way first, and known by that error. What a few hundred iterations do not find is not drawn.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from bench.metrics import position_error
from bench.suite import ScenarioEntry
from bench.truth import true_recording
from envs.recording import Recording
from games.follow import follow_root
from games.game import Game
from games.kkt import consistent_costates
from games.nearest_root import nearest_root
from games.olne import solve_olne

_ITERATIONS = 300  # of IPOPT
_TOLERANCE = 1e-6, 1e-4  # [m] and relative, of the error that is known


def replay(scenario: ScenarioEntry, trial: Mapping[Any, Any]) -> np.ndarray | None:
    """The predicted states (T, N, n) of a trial.

    Args:
        scenario: of the trial.
        trial: its row, with ``seed, status, weights, position_error, published_forward``.

    Returns:
        None where the trial has no prediction, or none with its error is found again.
    """
    game = true_recording(scenario, int(trial["seed"])).scenario.game
    weights = estimated_weights(trial["weights"], game)
    if trial["status"] != "ok" or weights is None:
        return None
    published, error = float(trial["published_forward"]), float(trial["position_error"])
    return _replay(
        scenario.model_dump_json(), int(trial["seed"]), weights.tobytes(), published, error
    )


def estimated_weights(value: Any, game: Game) -> np.ndarray | None:
    """Weights (N, K) of a row, or None where the trial left none that the game can take."""
    try:
        rows = np.array([list(row) for row in value], dtype=float)
        return game.check_weights(rows)
    except (TypeError, ValueError):
        return None


@lru_cache(maxsize=4096)  # the page and the figures show the same trials
def _replay(
    scenario: str, seed: int, weights: bytes, published: float, error: float
) -> np.ndarray | None:
    recording = true_recording(ScenarioEntry.model_validate_json(scenario), seed)
    shaped = np.frombuffer(weights).reshape(recording.scenario.weights.shape)
    absolute, relative = _TOLERANCE
    for find in _ways(recording, shaped, published):
        states = find()
        if states is None:
            continue
        if abs(position_error(recording.states, states) - error) <= absolute + relative * error:
            return states
    return None


def _ways(
    recording: Recording, weights: np.ndarray, published: float
) -> Iterator[Callable[[], np.ndarray | None]]:
    """Searches for a root, those first that are cheap or are known to have found it."""
    game = recording.scenario.game
    states, controls = recording.states, recording.controls

    def followed() -> np.ndarray | None:
        root = follow_root(game, recording.root, recording.scenario.weights, weights)
        return None if root is None else root.states

    def near(costates: np.ndarray) -> np.ndarray | None:
        found = nearest_root(game, weights, states, controls, costates, max_iterations=_ITERATIONS)
        return None if found is None else found.states

    def equilibrium() -> np.ndarray | None:
        found = solve_olne(game, weights, states[0], initial_controls=controls)
        return found.states if found.certificate.passed else None

    def consistent() -> np.ndarray | None:
        costates = consistent_costates(game, states, controls, weights)
        return near(costates) if np.isfinite(costates).all() else None

    yield followed
    if published or math.isnan(published):
        yield lambda: near(np.zeros((game.horizon - 1, *game.state_shape[1:])))
    if not published or math.isnan(published):
        yield equilibrium
        yield consistent
