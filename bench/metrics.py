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


def identifiable_cosine_error(
    weights: np.ndarray, estimated: np.ndarray, projections: np.ndarray
) -> np.ndarray:
    """Cosine errors that remain where errors the data cannot show are forgiven.

    Of each player's error, on the simplex, only the part in directions that the data identify
    (``games.information.identifiability``) is kept; what is left is measured like ``cosine_error``,
    and equal to it where all directions are identified.

    Args:
        weights: (N, K) true weights.
        estimated: (S, N, K) estimates.
        projections: (N, K, K) on the identified directions, which lie in the simplex.

    Returns:
        (S,) one error per estimate.
    """
    truth = weights / weights.sum(axis=1, keepdims=True)
    shares = estimated / estimated.sum(axis=2, keepdims=True)
    kept = truth + np.einsum("ikl,sil->sik", projections, shares - truth)
    products = np.einsum("ik,sik->si", truth, kept)
    norms = np.linalg.norm(truth, axis=1) * np.linalg.norm(kept, axis=2)
    return np.maximum(0.0, 1 - products / norms).mean(axis=1)


def position_error(states: np.ndarray, other: np.ndarray) -> float:
    """Mean absolute difference [m] of px and py over time and players.

    Args:
        states: (T, N, n).
        other: (T, N, n).
    """
    return float(np.mean(np.abs(states[..., :2] - other[..., :2])))
