"""Predictions of stored trials, computed again for pictures.

A store keeps only the error of each prediction. So the motion is searched again, the cheapest way
first, and recognised by its error. A motion that a few dozen iterations do not find is not drawn,
nor is one that the published step does not find, as in the published figures.
"""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
import pandas as pd

from olne_bench.bench.judge.metrics.formulas import position_error
from olne_bench.bench.judge.truth import Draw, true_recording
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.envs.recordings.recording import Recording
from olne_bench.games.model.game import Game
from olne_bench.games.solve.nearest_root import nearest_root, predict
from olne_bench.games.solve.root_following import follow_weights

_ITERATIONS = 60  # of IPOPT
_TOLERANCE = 1e-6, 1e-4  # [m] and relative, of the error that is known


def predict_again(draw: Draw, trial: Mapping[Any, Any]) -> np.ndarray | None:
    """The predicted states (T, N, n) of a trial.

    Args:
        draw: draw of the trial.
        trial: its row, with ``seed, status, weights, unknowns, position_error,
            published_forward``.

    Returns:
        None if the trial has no prediction by the published step, or no motion with its error is
        found.

    Raises:
        NotDrawnError: if its weights do not fit the scenario.
    """
    told = true_recording(draw).scenario.told
    weights = estimated_weights(trial["weights"], told)
    if trial["status"] != "ok" or weights is None or trial["published_forward"] == 0:
        return None
    theta = weights
    if told.parameters.used.any():
        unknowns = np.array([list(row) for row in trial["unknowns"]], dtype=float)
        theta = np.hstack([weights, told.parameters.standardised(unknowns)])
    return _predict_again(draw, theta.tobytes(), float(trial["position_error"]))


def estimated_weights(value: Any, game: Game) -> np.ndarray | None:
    """Weights (N, K) of a row; None if it has none.

    Raises:
        NotDrawnError: on weights that the game does not accept, such as those of another version.
    """
    if value is None or (isinstance(value, float) and np.isnan(value)) or value is pd.NA:
        return None
    try:
        rows = np.array([list(row) for row in value], dtype=float)
        game.check_weights(rows)
    except (TypeError, ValueError) as error:
        raise NotDrawnError(f"stored weights do not fit the scenario: {error}") from error
    return rows  # unscaled: rounding can change where the published step ends


@lru_cache(maxsize=4096)  # the page and the figures show the same trials
def _predict_again(draw: Draw, theta: bytes, error: float) -> np.ndarray | None:
    recording = true_recording(draw)
    shaped = np.frombuffer(theta).reshape(recording.scenario.theta.shape)
    absolute, relative = _TOLERANCE
    for find in (_followed, _nearest):
        states = find(recording, shaped)
        if states is None:
            continue
        if abs(position_error(recording.states, states) - error) <= absolute + relative * error:
            return states
    return None


def _followed(recording: Recording, theta: np.ndarray) -> np.ndarray | None:
    truth = recording.scenario
    root = follow_weights(truth.told, recording.root, truth.theta, theta)
    return None if root is None else root.states


def _nearest(recording: Recording, theta: np.ndarray) -> np.ndarray | None:
    truth = recording.scenario
    if truth.told.constraints or truth.told.parameters.count:
        found = predict(truth.told, theta, recording.root, truth.theta).root
        return None if found is None else found.states
    root = nearest_root(
        truth.told,
        theta,
        recording.states,
        recording.controls,
        np.zeros_like(recording.costates),
        max_iterations=_ITERATIONS,
    )
    return None if root is None else root.states
