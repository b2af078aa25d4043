"""Coordinates in which the prior of weights and unknowns is a standard normal distribution.

A player's shares s lie on the plain simplex and have a Dirichlet distribution with all parameters
alpha (theta = floor + (1 - K floor) s). They are broken off a stick one after the other,

    s_k = v_k (1 - v_1) ... (1 - v_{k-1}),    v_k ~ Beta(alpha, (K - k) alpha),  k < K,

with independent v_k, so that z_k = Phi^-1(F_k(v_k)) are independent standard normal numbers, where
F_k is the distribution function of v_k. A standardised unknown has a normal prior within its range;
its coordinate is found in the same way. Where data say nothing, the posterior is the same Gaussian;
where they say much, any smooth chart makes it one. In log-ratios it has the long tail of a weight
that may as well be zero.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import betainc, betaincinv, ndtr, ndtri

from olne_bench.games.model.unknowns import Parameters

#: Step of finite differences.
_SMALL = 1e-5

#: Coordinates beyond have a prior probability of 1e-15, and their weights are at the floor.
_FARTHEST = 8.0


@dataclass(frozen=True)
class NormalChart:
    """The chart of theta of all players.

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
