"""Metrics: pure functions of estimate and truth."""

import numpy as np


def cosine_error(weights: np.ndarray, estimated: np.ndarray) -> float:
    """Mean over players of 1 - cos(angle) between true and estimated weights.

    Peters et al. 2021, eqn. cosine_metric. Invariant to the scale of each player's weights.

    Args:
        weights: (N, K) true weights.
        estimated: (N, K).
    """
    products = np.sum(weights * estimated, axis=1)
    norms = np.linalg.norm(weights, axis=1) * np.linalg.norm(estimated, axis=1)
    # Rounding can take the cosine of equal vectors past one.
    return float(np.mean(np.maximum(0.0, 1 - products / norms)))


def position_error(states: np.ndarray, other: np.ndarray) -> float:
    """Mean absolute difference [m] of px and py over time and players.

    Args:
        states: (T, N, n).
        other: (T, N, n).
    """
    return float(np.mean(np.abs(states[..., :2] - other[..., :2])))
