"""Coordinates of weights: every player's row lies on a simplex above a floor.

With theta^i = floor + (1 - K floor) s^i the share s^i lies on the plain simplex. Charts of it:

- log-ratios phi_k = log(s_k / s_K), any real numbers: for filters, whose state has no bounds;
- ratios r_k = s_k / s_ref >= 0 to a reference weight: for optimisers with bounds, as they include
  shares of zero;
- coordinates in which a prior is a standard normal distribution (``NormalChart``).
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import casadi as ca
import numpy as np
from scipy.special import betainc, betaincinv, ndtr, ndtri, polygamma

from olne_bench.games.model.unknowns import Parameters


def from_log_ratios(log_ratios: np.ndarray, num_weights: int, floor: float) -> np.ndarray:
    """Weights (..., N, K) of log-ratios (..., N*(K-1))."""
    shares = log_ratios.reshape(*log_ratios.shape[:-1], -1, num_weights - 1)
    shares = np.concatenate([shares, np.zeros_like(shares[..., :1])], axis=-1)
    shares = np.exp(shares - shares.max(axis=-1, keepdims=True))
    shares /= shares.sum(axis=-1, keepdims=True)
    return np.asarray(floor + (1 - num_weights * floor) * shares)


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


#: Step of finite differences.
_SMALL = 1e-5

#: Coordinates beyond have a prior probability of 1e-15, and their weights are at the floor.
_FARTHEST = 8.0


@dataclass(frozen=True)
class NormalChart:
    """The chart in which the prior of weights and unknowns is a standard normal distribution.

    A player's shares have a Dirichlet distribution with all parameters alpha. They are broken off a
    stick one after the other,

        s_k = v_k (1 - v_1) ... (1 - v_{k-1}),    v_k ~ Beta(alpha, (K - k) alpha),  k < K,

    with independent v_k, so that z_k = Phi^-1(F_k(v_k)) are independent standard normal numbers,
    where F_k is the distribution function of v_k. A standardised unknown has a normal prior within
    its range; its coordinate is found in the same way. Where data say nothing, the posterior is the
    same Gaussian; where they say much, any smooth chart makes it one. In log-ratios it has the long
    tail of a weight that may as well be zero.

    Attributes:
        players: N.
        num_weights: K.
        floor: smallest weight.
        alpha: parameter of the Dirichlet distribution.
        parameters: the game's unknowns.
    """

    players: int
    num_weights: int
    floor: float
    alpha: float
    parameters: Parameters

    @property
    def size(self) -> int:
        """Number of coordinates, N*(K-1) and one for each unknown."""
        return self.players * (self.num_weights - 1) + int(self.parameters.used.sum())

    def theta(self, points: np.ndarray) -> np.ndarray:
        """(..., N, K + U): weights and standardised unknowns of points (..., size)."""
        return np.concatenate([self.weights(points), self.standardised(points)], axis=-1)

    def weights(self, points: np.ndarray) -> np.ndarray:
        """Weights (..., N, K) of points (..., size)."""
        sticks = self._sticks(points)
        first, second = self._shapes()
        low = sticks <= 0  # where v, or else 1 - v, keeps its digits
        part = betaincinv(np.where(low, first, second), np.where(low, second, first), _tail(sticks))
        broken, left = np.where(low, part, 1 - part), np.where(low, 1 - part, part)
        ones = np.ones_like(sticks[..., :1])
        shares = np.concatenate([broken, ones], axis=-1)
        shares[..., 1:] *= np.cumprod(left, axis=-1)
        return self.floor + (1 - self.num_weights * self.floor) * shares

    def standardised(self, points: np.ndarray) -> np.ndarray:
        """Standardised unknowns (..., N, U); zero in columns that stand for nothing."""
        used = self.parameters.used
        found = np.zeros((*points.shape[:-1], *used.shape))
        low, high = (ndtr(bound[used]) for bound in self.parameters.bounds())
        unknown = points[..., self.players * (self.num_weights - 1) : self.size]
        found[..., used] = ndtri(low + (high - low) * ndtr(unknown))
        return found

    def point(self, theta: np.ndarray) -> np.ndarray:
        """Coordinates (size,) of theta (N, K + U), at most 8 in size."""
        shares = (theta[:, : self.num_weights] - self.floor) / (1 - self.num_weights * self.floor)
        shares = np.maximum(shares, 0.0)
        rest = np.cumsum(shares[:, ::-1], axis=1)[:, ::-1]
        broken = shares[:, :-1] / np.maximum(rest[:, :-1], np.finfo(float).tiny)
        left = rest[:, 1:] / np.maximum(rest[:, :-1], np.finfo(float).tiny)
        first, second = self._shapes()
        below, above = betainc(first, second, broken), betainc(second, first, left)
        sticks = np.where(below < above, ndtri(below), -ndtri(above))
        used = self.parameters.used
        low, high = (ndtr(bound[used]) for bound in self.parameters.bounds())
        unknown = ndtri((ndtr(theta[:, self.num_weights :][used]) - low) / (high - low))
        return np.concatenate([sticks.ravel(), unknown]).clip(-_FARTHEST, _FARTHEST)

    def jacobian(self, points: np.ndarray) -> np.ndarray:
        """(..., N*(K+U), size): derivative of theta at points, by central differences."""
        steps = _SMALL * np.eye(self.size)
        change = self.theta(points[..., None, :] + steps) - self.theta(points[..., None, :] - steps)
        flat = change.reshape(*points.shape, -1)
        return np.asarray(np.swapaxes(flat, -1, -2) / (2 * _SMALL))

    def _sticks(self, points: np.ndarray) -> np.ndarray:
        free = self.num_weights - 1
        return points[..., : self.players * free].reshape(*points.shape[:-1], self.players, free)

    def _shapes(self) -> tuple[np.ndarray, np.ndarray]:
        """Both parameters (K-1,) of the Beta distributions of v."""
        after = np.arange(self.num_weights - 1, 0, -1)
        return np.full(len(after), self.alpha), self.alpha * after


def _tail(normal: np.ndarray) -> np.ndarray:
    """Probability beyond |normal|."""
    return np.asarray(ndtr(-np.abs(normal)))
