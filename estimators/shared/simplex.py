"""Coordinates of weights: every player's row lies on a simplex above a floor.

With theta^i = floor + (1 - K floor) s^i the share s^i lies on the plain simplex. Two charts of it:

- log-ratios phi_k = log(s_k / s_K), any real numbers: for filters, whose state has no bounds;
- ratios r_k = s_k / s_ref >= 0 to a reference weight: for optimisers with bounds, as they include
  shares of zero.
"""

from functools import lru_cache
from typing import Protocol

import casadi as ca
import numpy as np
from scipy.special import polygamma


def from_log_ratios(log_ratios: np.ndarray, num_weights: int, floor: float) -> np.ndarray:
    """Weights (..., N, K) of log-ratios (..., N*(K-1))."""
    shares = log_ratios.reshape(*log_ratios.shape[:-1], -1, num_weights - 1)
    shares = np.concatenate([shares, np.zeros_like(shares[..., :1])], axis=-1)
    shares = np.exp(shares - shares.max(axis=-1, keepdims=True))
    shares /= shares.sum(axis=-1, keepdims=True)
    return floor + (1 - num_weights * floor) * shares


def log_ratios_of(weights: np.ndarray, floor: float) -> np.ndarray:
    """Log-ratios (N*(K-1),) of weights (N, K) above the floor."""
    shares = weights - floor
    return np.log(shares[:, :-1] / shares[:, -1:]).ravel()


def flat_covariance(players: int, num_weights: int) -> np.ndarray:
    """Covariance (N*(K-1), N*(K-1)) of the log-ratios of shares that are uniform on the simplex.

    Such shares are proportional to exponential variables; the variance of their logarithm is the
    trigamma function at 1. The mean of the log-ratios is zero.
    """
    free = num_weights - 1
    return np.kron(np.eye(players), polygamma(1, 1) * (np.eye(free) + np.ones((free, free))))


def by_log_ratios(log_ratios: np.ndarray, num_weights: int, floor: float) -> np.ndarray:
    """Derivative (N*K, N*(K-1)) of the weights in their log-ratios (N*(K-1),)."""
    players = len(log_ratios) // (num_weights - 1)
    return np.array(_log_ratio_jacobian(players, num_weights)(log_ratios, floor))


@lru_cache(maxsize=32)
def _log_ratio_jacobian(players: int, num_weights: int) -> ca.Function:
    """(phi, floor) -> d weights / d phi (N*K, N*(K-1))."""
    phi, floor = ca.SX.sym("phi", players * (num_weights - 1)), ca.SX.sym("floor")
    rows = []
    for own in ca.vertsplit(phi, num_weights - 1):
        sizes = ca.exp(ca.vertcat(own, 0))
        rows.append(floor + (1 - num_weights * floor) * sizes / ca.sum1(sizes))
    jacobian = ca.jacobian(ca.vertcat(*rows), phi)
    return ca.Function("weights_phi", [phi, floor], [ca.densify(jacobian)])


class Chart(Protocol):
    """Coordinates of weights (N, K), from zero on."""

    @property
    def size(self) -> int:
        """Number of coordinates."""

    def ratios(self, weights: np.ndarray) -> np.ndarray:
        """Coordinates (size,) of weights."""

    def weights(self, ratios: np.ndarray) -> np.ndarray:
        """Weights of coordinates."""

    def jacobian(self, ratios: np.ndarray) -> np.ndarray:
        """(N*K, size) derivative of the weights."""


class RatioChart:
    """Ratios to a reference weight of each player, non-negative.

    Attributes:
        size: number of coordinates, N*(K-1).
    """

    def __init__(self, weights: np.ndarray, floor: float) -> None:
        """The chart whose references are the largest of weights (N, K)."""
        self._shape, self._floor = weights.shape, floor
        self._own = np.ones(weights.shape, dtype=bool)
        self._own[np.arange(len(weights)), weights.argmax(axis=1)] = False
        self.size = int(self._own.sum())

    def ratios(self, weights: np.ndarray) -> np.ndarray:
        """Coordinates (N*(K-1),) of weights (N, K)."""
        shares = np.maximum(weights - self._floor, 0.0)
        return (shares / shares[~self._own][:, None])[self._own]

    def weights(self, ratios: np.ndarray) -> np.ndarray:
        """Weights (N, K) of coordinates."""
        return np.array(self._functions()[0](ratios, self._floor)).reshape(self._shape)

    def jacobian(self, ratios: np.ndarray) -> np.ndarray:
        """(N*K, N*(K-1)) derivative of the weights."""
        return np.array(self._functions()[1](ratios, self._floor))

    def holds(self, weights: np.ndarray) -> bool:
        """Whether the references still are large enough to divide by."""
        return bool((weights[~self._own] > 0.1 * weights.max(axis=1)).all())

    def _functions(self) -> tuple[ca.Function, ca.Function]:
        return _ratio_chart(self._own.tobytes(), self._shape[1])


@lru_cache(maxsize=64)
def _ratio_chart(own: bytes, num_weights: int) -> tuple[ca.Function, ca.Function]:
    """(r, floor) -> weights (N*K,), and their Jacobian in r."""
    free = np.frombuffer(own, dtype=bool)
    ratios, floor = ca.SX.sym("r", int(free.sum())), ca.SX.sym("floor")
    sizes = ca.SX.ones(free.size)
    sizes[np.flatnonzero(free).tolist()] = ratios
    rows = [
        floor + (1 - num_weights * floor) * row / ca.sum1(row)
        for row in ca.vertsplit(sizes, num_weights)
    ]
    weights = ca.vertcat(*rows)
    return (
        ca.Function("weights", [ratios, floor], [weights]),
        ca.Function("weights_r", [ratios, floor], [ca.densify(ca.jacobian(weights, ratios))]),
    )
