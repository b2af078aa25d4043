"""Coordinates of weights: every player's row lies on a simplex above a floor.

With theta^i = floor + (1 - K floor) s^i the share s^i lies on the plain simplex. Charts of it:

- ratios r_k = s_k / s_ref >= 0 to a reference weight: for optimisers with bounds, as they include
  shares of zero;
- coordinates in which a prior is a standard normal distribution (``NormalChart``): for filters and
  samplers, whose states have no bounds.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import casadi as ca
import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.special import betainc, betaincinv, betaln, expit, ndtr, ndtri, xlogy

from olne_bench.estimators.protocol import Problem
from olne_bench.games.model.unknowns import Parameters
from olne_bench.games.model.weight_prior import WeightPrior


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
    """Ratios (N*(K-1),) to a reference weight of each player, non-negative."""

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


#: Coordinates beyond have a prior probability of 1e-15, and their weights are at the floor.
_FARTHEST = 8.0
#: Knots of the splines of sticks.
_GRID, _KNOTS = 12.0, 3073


@dataclass(frozen=True)
class NormalChart:
    """The chart in which the prior of weights and unknowns is a standard normal distribution.

    A player's shares have a Dirichlet distribution with parameters alpha. They are broken off a
    stick one after the other,

        s_k = v_k (1 - v_1) ... (1 - v_{k-1}),    v_k ~ Beta(alpha_k, sum_{j>k} alpha_j),  k < K,

    with independent v_k, so that z_k = Phi^-1(F_k(v_k)) are independent standard normal numbers,
    where F_k is the distribution function of v_k. A standardised unknown has a normal prior within
    its range; its coordinate is found in the same way. Where data say nothing, the posterior is the
    same Gaussian; where they say much, any smooth chart makes it one. In log-ratios it has the long
    tail of a weight that may as well be zero.

    A mixture has the chart of the one distribution with its mean and spread; ``tilt`` is what is
    left.
    """

    players: int  # N
    num_weights: int  # K
    floor: float  # smallest weight
    prior: WeightPrior  # of each player's weights
    parameters: Parameters  # the game's unknowns

    @classmethod
    def of(cls, problem: Problem) -> "NormalChart":
        """The chart of what a problem says is known."""
        game = problem.game
        size = game.num_players, game.num_weights, problem.weight_floor
        return cls(*size, problem.prior, game.parameters)

    @property
    def free(self) -> int:
        """Number of coordinates of weights, N*(K-1)."""
        return self.players * (self.num_weights - 1)

    @property
    def size(self) -> int:
        """Number of coordinates, N*(K-1) and one for each unknown."""
        return self.free + int(self.parameters.used.sum())

    def theta(self, points: np.ndarray) -> np.ndarray:
        """(..., N, K + U): weights and standardised unknowns of points (..., size)."""
        return np.concatenate([self.weights(points), self.standardised(points)], axis=-1)

    def weights(self, points: np.ndarray) -> np.ndarray:
        """Weights (..., N, K) of points (..., size)."""
        return np.asarray(self.floor + self._above * self._shares(points)[0])

    def standardised(self, points: np.ndarray) -> np.ndarray:
        """Standardised unknowns (..., N, U); zero in columns that stand for nothing."""
        used = self.parameters.used
        found = np.zeros((*points.shape[:-1], *used.shape))
        low, high = (ndtr(bound[used]) for bound in self.parameters.bounds())
        unknown = points[..., self.free : self.size]
        found[..., used] = ndtri(low + (high - low) * ndtr(unknown))
        return found

    def point(self, theta: np.ndarray) -> np.ndarray:
        """Coordinates (size,) of theta (N, K + U), at most 8 in size."""
        shares = np.maximum((theta[:, : self.num_weights] - self.floor) / self._above, 0.0)
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
        """(..., N*(K+U), size): derivative of theta at points (..., size).

        CasADi has no incomplete beta function. The slope of its inverse is a ratio of two
        densities.
        """
        return self._jacobian(points, *self._shares(points))

    def _jacobian(
        self, points: np.ndarray, shares: np.ndarray, broken: np.ndarray, left: np.ndarray
    ) -> np.ndarray:
        first, second = self._shapes()
        logs = xlogy(first - 1, broken) + xlogy(second - 1, left) - betaln(first, second)
        slope = np.exp(_log_normal(self._sticks(points)) - logs)
        own = np.arange(self.num_weights - 1)
        by_stick = np.zeros((*shares.shape, len(own)))
        later = own[:, None] < np.arange(self.num_weights)
        ratio = slope / np.maximum(left, np.finfo(float).tiny)
        by_stick[:] = -shares[..., None] * ratio[..., None, :] * later.T
        before = np.cumprod(np.concatenate([np.ones_like(left[..., :1]), left], -1), -1)[..., :-1]
        by_stick[..., own, own] = before * slope
        width = self.num_weights + self.parameters.count
        found = np.zeros((*points.shape[:-1], self.players, width, self.size))
        for i in range(self.players):
            place = slice(i * len(own), (i + 1) * len(own))
            found[..., i, : self.num_weights, place] = self._above * by_stick[..., i, :, :]
        used = self.parameters.used
        if used.any():
            low, high = (ndtr(bound[used]) for bound in self.parameters.bounds())
            unknown = points[..., self.free : self.size]
            standardised = ndtri(low + (high - low) * ndtr(unknown))
            rows, columns = np.nonzero(used)
            found[..., rows, self.num_weights + columns, self.free + np.arange(len(rows))] = (
                high - low
            ) * np.exp(_log_normal(unknown) - _log_normal(standardised))
        return np.asarray(found.reshape(*points.shape[:-1], -1, self.size))

    def at(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``theta`` and ``jacobian`` of points (..., size), at the cost of one of them."""
        known = self._shares(points)
        weights = self.floor + self._above * known[0]
        theta = np.concatenate([weights, self.standardised(points)], axis=-1)
        return theta, self._jacobian(points, *known)

    def tilt(self, points: np.ndarray) -> np.ndarray:
        """Log (...) of the prior's density over that of the chart, at points (..., size)."""
        if len(self.prior.shares) == 1:
            return np.zeros(points.shape[:-1])
        shares = self._shares(points)[0]
        chart = WeightPrior((tuple(self._alpha),))
        gain = self.prior.log_density(shares) - chart.log_density(shares)
        return np.asarray(gain.sum(axis=-1))

    @property
    def _above(self) -> float:
        """What a weight may have above the floor."""
        return 1 - self.num_weights * self.floor

    @property
    def _alpha(self) -> np.ndarray:
        return self.prior.matched(self.num_weights)

    def _sticks(self, points: np.ndarray) -> np.ndarray:
        return points[..., : self.free].reshape(
            *points.shape[:-1], self.players, self.num_weights - 1
        )

    def _shares(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Shares (..., N, K), and what is broken off each stick and left of it (..., N, K-1)."""
        sticks = self._sticks(points)
        logits = np.empty_like(sticks)
        for k, shape in enumerate(np.transpose(self._shapes()).tolist()):
            logits[..., k] = _stick(*shape)(sticks[..., k])
        broken, left = expit(logits), expit(-logits)
        shares = np.concatenate([broken, np.ones_like(sticks[..., :1])], axis=-1)
        shares[..., 1:] *= np.cumprod(left, axis=-1)
        return shares, broken, left

    def _shapes(self) -> tuple[np.ndarray, np.ndarray]:
        """Both parameters (K-1,) of the Beta distributions of v."""
        alpha = self._alpha
        return alpha[:-1], np.cumsum(alpha[::-1])[::-1][1:]


@lru_cache(maxsize=256)
def _stick(first: float, second: float) -> CubicHermiteSpline:
    """The logit of v ~ Beta(first, second) as a function of z = Phi^-1(F(v)), to about 1e-10.

    The inverse of F itself takes thirty times as long.
    """
    z = np.linspace(-_GRID, _GRID, _KNOTS)
    low = z <= 0  # where v, or else 1 - v, keeps its digits
    part = betaincinv(np.where(low, first, second), np.where(low, second, first), ndtr(-np.abs(z)))
    known = part > np.finfo(float).tiny
    z, low, part = z[known], low[known], part[known]
    less, rest = np.log(part), np.log1p(-part)
    log_v, log_left = np.where(low, less, rest), np.where(low, rest, less)
    slope = np.exp(_log_normal(z) - first * log_v - second * log_left + betaln(first, second))
    return CubicHermiteSpline(z, log_v - log_left, slope)


def _log_normal(points: np.ndarray) -> np.ndarray:
    """Log of the standard normal density."""
    return np.asarray(-(points**2) / 2 - np.log(2 * np.pi) / 2)
