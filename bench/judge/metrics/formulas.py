"""What metrics compute: pure functions of arrays."""

import numpy as np
from scipy.special import chdtr

from olne_bench.games.model.simplex import simplex_tangent

_SINGULAR = 1e-14  # variances, relative to the largest one
_EXACT = 1e-9  # errors of weights, which sum to one
_LEAST = 1e-12  # weights below are as good as zero, so that log-ratios are finite


def cosine_error(weights: np.ndarray, estimated: np.ndarray) -> float:
    """Mean over players of 1 - cos(angle) between true weights (N, K) and estimated ones (N, K).

    Peters et al. 2021, eqn. cosine_metric. Invariant to the scale of each player's weights.
    """
    return float(np.mean(cosine_errors(weights, estimated)))


def cosine_errors(weights: np.ndarray, estimated: np.ndarray) -> np.ndarray:
    """1 - cos(angle) between true weights (..., K) and estimated ones: (...)."""
    products = np.sum(weights * estimated, axis=-1)
    norms = np.linalg.norm(weights, axis=-1) * np.linalg.norm(estimated, axis=-1)
    # Rounding can take the cosine of equal vectors past one.
    return np.asarray(np.maximum(0.0, 1 - products / norms))


def identifiable_cosine_error(
    weights: np.ndarray, estimated: np.ndarray, projections: np.ndarray
) -> np.ndarray:
    """Cosine errors (S,) without the errors in directions that the data do not identify.

    Each player's weights are scaled to sum to one, and their error is projected onto the identified
    directions (``games.solve.information.identifiability``).

    Args:
        weights: (N, K) true weights.
        estimated: (S, N, K) estimates.
        projections: (N, K, K) onto identified directions, in the tangent space of the simplex.
    """
    truth = weights / weights.sum(axis=1, keepdims=True)
    shares = estimated / estimated.sum(axis=2, keepdims=True)
    kept = truth + np.einsum("ikl,sil->sik", projections, shares - truth)
    products = np.einsum("ik,sik->si", truth, kept)
    norms = np.linalg.norm(truth, axis=1) * np.linalg.norm(kept, axis=2)
    return np.asarray(np.maximum(0.0, 1 - products / norms).mean(axis=1))


def position_error(states: np.ndarray, other: np.ndarray) -> float:
    """Mean absolute difference [m] of px and py of states (T, N, n), over time and players."""
    return float(np.mean(np.abs(states[..., :2] - other[..., :2])))


def ellipsoid_level(weights: np.ndarray, estimated: np.ndarray, covariance: np.ndarray) -> float:
    """Level of the ellipsoid of a covariance on whose surface the truth lies.

    Rows of weights sum to one, so the ellipsoid lies in the tangent space of the simplex, which has
    N*(K-1) dimensions. The level is the chi-squared probability of the truth's distance. A
    direction without variance means that the estimate is exact there, so any error along it gives
    1.

    Args:
        weights: (N, K) true weights.
        estimated: (N, K).
        covariance: (N*K, N*K) of the estimate.
    """
    players, count = weights.shape
    tangent = simplex_tangent(players, count)
    spread = tangent.T @ covariance @ tangent
    error = tangent.T @ (estimated - weights).ravel()
    values, vectors = np.linalg.eigh((spread + spread.T) / 2)
    along = vectors.T @ error
    flat = values <= _SINGULAR * max(values[-1], 0.0)
    if (np.abs(along[flat]) > _EXACT).any():
        return 1.0
    if flat.all():
        return 0.0
    distance = float(np.sum(along[~flat] ** 2 / values[~flat]))
    return float(chdtr(np.count_nonzero(~flat), distance))


def sample_level(weights: np.ndarray, samples: np.ndarray) -> float:
    """Share of samples (M, N, K) that are closer to their mean than the true weights (N, K) are.

    Distances are Mahalanobis distances in log-ratios of weights, where samples lie around their
    mean more evenly than on the simplex. Being a share of the samples, it assumes no distribution
    of theirs.
    """
    points, truth = _log_ratios(samples), _log_ratios(weights[None])[0]
    mean = points.mean(axis=0)
    spread = np.atleast_2d(np.cov(points, rowvar=False))
    inverse = np.linalg.pinv(spread, hermitian=True)

    def distance(places: np.ndarray) -> np.ndarray:
        away = places - mean
        return np.asarray(np.einsum("...i,ij,...j->...", away, inverse, away))

    return float(np.mean(distance(points) < distance(truth)))


def covariance_width(covariance: np.ndarray, shape: tuple[int, int]) -> float:
    """Geometric mean of the standard deviations along the axes of a covariance (N*K, N*K).

    Its weights have the shape (N, K) and rows that sum to one.
    """
    tangent = simplex_tangent(*shape)
    spread = tangent.T @ covariance @ tangent
    variances = np.linalg.eigvalsh((spread + spread.T) / 2)
    return float(np.exp(np.mean(np.log(np.maximum(variances, _LEAST**2))) / 2))


def sample_width(samples: np.ndarray) -> float:
    """``covariance_width`` of samples (M, N, K)."""
    covariance = np.cov(samples.reshape(len(samples), -1), rowvar=False)
    return covariance_width(covariance, (samples.shape[1], samples.shape[2]))


def _log_ratios(samples: np.ndarray) -> np.ndarray:
    logarithms = np.log(np.maximum(samples, _LEAST))
    return np.asarray((logarithms[..., :-1] - logarithms[..., -1:]).reshape(len(samples), -1))
