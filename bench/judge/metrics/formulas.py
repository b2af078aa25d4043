"""What metrics compute: pure functions of arrays."""

import numpy as np
from scipy.special import chdtri

from olne_bench.games.simplex import simplex_tangent

_SINGULAR = 1e-14  # variances, relative to the largest one
_EXACT = 1e-9  # errors of weights, which sum to one


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
    """Cosine errors without the errors in directions that the data do not identify.

    Each player's weights are scaled to sum to one, and their error is projected onto the
    identified directions (``games.information.identifiability``). The result equals
    ``cosine_error`` if all directions are identified.

    Args:
        weights: (N, K) true weights.
        estimated: (S, N, K) estimates.
        projections: (N, K, K) matrices that project onto the identified directions, in the tangent
            space of the simplex.

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


def covers_truth(
    weights: np.ndarray, estimated: np.ndarray, covariance: np.ndarray, level: float = 0.95
) -> bool:
    """Whether the truth lies in the ellipsoid of an estimate's covariance.

    Each player's weights sum to one, so the ellipsoid lies in the tangent space of the simplex,
    which has N*(K-1) dimensions. Its size is the chi-squared quantile of the level.

    Args:
        weights: (N, K) true weights, rows sum to one.
        estimated: (N, K), rows sum to one.
        covariance: (N*K, N*K) of the estimate.
        level: probability with which an ellipsoid should hold the truth.

    Returns:
        Whether the truth is inside. A direction without variance means that the estimate is exact
        there, so any error in this direction puts the truth outside.
    """
    players, count = weights.shape
    tangent = simplex_tangent(players, count)
    spread = tangent.T @ covariance @ tangent
    error = tangent.T @ (estimated - weights).ravel()
    values, vectors = np.linalg.eigh((spread + spread.T) / 2)
    along = vectors.T @ error
    flat = values <= _SINGULAR * max(values[-1], 0.0)
    if (np.abs(along[flat]) > _EXACT).any():
        return False
    distance = float(np.sum(along[~flat] ** 2 / values[~flat]))
    return bool(flat.all() or distance <= chdtri(np.count_nonzero(~flat), 1 - level))
