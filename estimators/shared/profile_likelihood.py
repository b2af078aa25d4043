"""The profile likelihood of weights: the least squared error with some weights held.

What is left open is fitted: initial states, the game's unknowns, and the weights that are not held.
Twice the difference of log-likelihoods, at weights that are held and at the maximum, has a
chi-squared distribution where they are true (Wilks 1938). The likelihood of weights is bent near
the simplex's boundary, so this region keeps its level where an ellipsoid does not.
"""

from dataclasses import dataclass

import numpy as np

from olne_bench.estimators.bilevel import OuterResiduals, StoppedError
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.forward_model import SolvedGame
from olne_bench.estimators.shared.simplex import Chart, RatioChart

_MOST_EVALUATIONS = 60


@dataclass(frozen=True)
class HeldWeights:
    """A chart without coordinates: all weights are held.

    Attributes:
        held: (N, K).
    """

    held: np.ndarray

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return 0

    def ratios(self, weights: np.ndarray) -> np.ndarray:
        """No coordinates."""
        return np.zeros(0)

    def weights(self, ratios: np.ndarray) -> np.ndarray:
        """The held weights."""
        return self.held

    def jacobian(self, ratios: np.ndarray) -> np.ndarray:
        """(N*K, 0)."""
        return np.zeros((self.held.size, 0))


def least_error(
    problem: Problem,
    observations: tuple[Observation, ...],
    games: tuple[SolvedGame, ...],
    *,
    held: bool = True,
) -> float | None:
    """The least squared error near some games, with their weights held or not.

    Args:
        problem: what is known; its noise is white.
        observations: one for each trajectory.
        games: a game of each at the same weights, from which the search starts.
        held: whether these weights are held.

    Returns:
        The sum of squared errors, each over its noise scale; None if the search fails.
    """
    weights = games[0].weights
    chart = HeldWeights(weights) if held else RatioChart(weights, problem.weight_floor)
    found = least_error_in(problem, observations, games, chart)
    return None if found is None else found[0]


def least_error_in(
    problem: Problem,
    observations: tuple[Observation, ...],
    games: tuple[SolvedGame, ...],
    chart: Chart,
) -> tuple[float, tuple[SolvedGame, ...]] | None:
    """The least squared error among weights of a chart, near some games, and the games there.

    Args:
        problem: as of ``least_error``.
        observations: one for each trajectory.
        games: a game of each at the same weights, from which the search starts.
        chart: its coordinates are fitted.

    Returns:
        None if the search fails.
    """
    residuals = OuterResiduals(problem, observations, games, chart)
    try:
        solution = residuals.minimised(_MOST_EVALUATIONS)
    except (StoppedError, ValueError):  # no equilibrium at the start
        return None
    return (2 * float(solution.cost), residuals.games) if solution.success else None
