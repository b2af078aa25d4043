"""Intervals of single weights from their profile likelihood.

With one weight held, everything else is fitted: the other weights, unknowns, and initial states.
Twice the loss of log-likelihood has a chi-squared distribution with one degree of freedom where the
held weight is true (Wilks 1938; Venzon and Moolgavkar 1988), so an interval of 95 % holds all
values that lose at most 3.84. It need not be symmetric, and it ends where weights end.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import brentq
from scipy.special import chdtri

from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.charts import RatioChart
from olne_bench.estimators.shared.forward_model import SolvedGame
from olne_bench.estimators.shared.outer_fit import least_error_in
from olne_bench.games.solve.root_following import follow_root

#: Ends are found to this share of their distance from the estimate.
_PRECISION = 0.01
#: First distance from the estimate, in standard errors, and by how much it grows.
_FIRST, _GROWTH = 1.6, 1.6
_SMALLEST_STEP = 1e-4


@dataclass(frozen=True)
class OneHeld:
    """A chart of weights (N, K) of which one is held; the others fill what is left."""

    start: np.ndarray  # (N, K) weights with the held one among them
    player: int  # whose weight is held
    weight: int  # which one
    floor: float  # least value of every weight

    @property
    def size(self) -> int:
        """N*(K-1) - 1."""
        return self._others.size + self._own.size

    def ratios(self, weights: np.ndarray) -> np.ndarray:
        """Coordinates of weights."""
        own = np.delete(weights[self.player], self.weight)[None] / self._left
        return np.concatenate([self._others.ratios(self._without(weights)), self._own.ratios(own)])

    def weights(self, ratios: np.ndarray) -> np.ndarray:
        """Weights (N, K) of coordinates."""
        others, own = np.split(ratios, [self._others.size])
        weights = np.empty_like(self.start)
        weights[self._rows] = self._others.weights(others)
        free = self._left * self._own.weights(own)[0]
        weights[self.player] = np.insert(free, self.weight, self.start[self.player, self.weight])
        return weights

    def jacobian(self, ratios: np.ndarray) -> np.ndarray:
        """(N*K, size) derivative of the weights."""
        others, own = np.split(ratios, [self._others.size])
        blocks = self._others.jacobian(others), self._left * self._own.jacobian(own)
        places = np.arange(self.start.size).reshape(self.start.shape)
        mine = np.delete(places[self.player], self.weight)
        found = np.zeros((self.start.size, self.size))
        found[np.concatenate([places[self._rows].ravel(), mine])] = block_diag(*blocks)
        return found

    @cached_property
    def _rows(self) -> np.ndarray:
        return np.delete(np.arange(len(self.start)), self.player)

    @property
    def _left(self) -> float:
        """What the player's other weights sum to."""
        return float(1 - self.start[self.player, self.weight])

    def _without(self, weights: np.ndarray) -> np.ndarray:
        return np.asarray(weights[self._rows])

    @cached_property
    def _others(self) -> RatioChart:
        return RatioChart(self._without(self.start), self.floor)

    @cached_property
    def _own(self) -> RatioChart:
        own = np.delete(self.start[self.player], self.weight)[None] / self._left
        return RatioChart(own, self.floor / self._left)


def profile_intervals(
    problem: Problem,
    observations: Sequence[Observation],
    games: Sequence[SolvedGame],
    deviations: np.ndarray,
    *,
    level: float = 0.95,
    deadline: float = np.inf,
) -> np.ndarray:
    """Intervals (N, K, 2) that hold each true weight with the probability ``level``.

    They are those of the mode of the likelihood in which the games are, one for each trajectory.
    Deviations (N, K) say how far to look first. Ends are NaN where no fit is found on the way to
    them, or by the deadline, in seconds of ``time.monotonic``. The noise is white, sigma positive.
    """
    games = tuple(games)
    weights = games[0].weights
    intervals = np.full((*weights.shape, 2), np.nan)
    for player, weight in np.ndindex(*weights.shape):
        if time.monotonic() > deadline:
            break
        profile = _Profile(problem, tuple(observations), games, player, weight, deadline)
        for end, sign in enumerate((-1, 1)):
            first = max(_FIRST * float(deviations[player, weight]), _SMALLEST_STEP)
            found = profile.end(sign, first, float(chdtri(1, 1 - level)))
            intervals[player, weight, end] = found
    return intervals


class _Profile:
    """The loss of log-likelihood, twice, where one weight is held."""

    def __init__(
        self,
        problem: Problem,
        observations: tuple[Observation, ...],
        games: tuple[SolvedGame, ...],
        player: int,
        weight: int,
        deadline: float,
    ) -> None:
        self._deadline = deadline
        self._problem, self._observations = problem, observations
        self._player, self._weight = player, weight
        self._games = games
        self._here = float(games[0].weights[player, weight])
        chart = RatioChart(games[0].weights, problem.weight_floor)
        best = least_error_in(problem, observations, games, chart, deadline)
        self._least = np.nan if best is None else best[0]

    def end(self, sign: int, first: float, most: float) -> float:
        """The value on one side of the estimate that loses ``most``; NaN if it is not found."""
        count = self._problem.game.num_weights
        floor = self._problem.weight_floor
        # The player's other weights share what is left above the floor, which must be something.
        edge = floor if sign < 0 else 1 - 2 * (count - 1) * floor
        room = abs(edge - self._here)
        if room <= _SMALLEST_STEP or not np.isfinite(self._least):
            return edge if room <= _SMALLEST_STEP else np.nan
        near, away = 0.0, min(first, room)
        games, tried = self._games, {}

        def loss(distance: float) -> float:
            nonlocal games
            if distance not in tried:
                found = self._fitted(self._here + sign * distance, games)
                if found is None:
                    raise _LostError
                tried[distance], games = found
            return (tried[distance] - self._least) / self._problem.sigma**2 - most

        try:
            while loss(away) < 0:
                if away >= room:
                    return edge
                near, away = away, min(_GROWTH * away, room)
            if near == 0:
                tried[0.0] = self._least
            distance = brentq(loss, near, away, xtol=_PRECISION * away)
        except _LostError:
            return float("nan")
        return float(self._here + sign * distance)

    def _fitted(
        self, value: float, games: tuple[SolvedGame, ...]
    ) -> tuple[float, tuple[SolvedGame, ...]] | None:
        """The least squared error with the weight at a value, from games nearby; and its games."""
        if time.monotonic() > self._deadline:
            return None
        floor = self._problem.weight_floor
        start = _with_weight(games[0].weights, self._player, self._weight, value, floor)
        chart = OneHeld(start, self._player, self._weight, floor)
        moved = []
        for one in games:
            there = replace(one, weights=start)
            root = follow_root(self._problem.game, one.root, one.theta, there.theta)
            if root is None:
                return None
            moved.append(replace(there, root=root))
        games = tuple(moved)
        return least_error_in(self._problem, self._observations, games, chart, self._deadline)


class _LostError(Exception):
    """No fit was found."""


def _with_weight(
    weights: np.ndarray, player: int, weight: int, value: float, floor: float
) -> np.ndarray:
    """Weights (N, K) with one at a value, and the player's others in proportion above the floor."""
    changed = weights.copy()
    others = np.arange(weights.shape[1]) != weight
    shares = np.maximum(weights[player, others] - floor, 0.0)
    shares = shares / shares.sum() if shares.sum() > 0 else np.full(len(shares), 1 / len(shares))
    changed[player, others] = floor + (1 - value - len(shares) * floor) * shares
    changed[player, weight] = value
    return changed
