"""The noise level, where nobody tells it: the most probable one given what the best fit leaves.

A priori log sigma is normal around that of ``Problem.sigma`` with the deviation tau
(``Problem.sigma_spread``). With the squared error S that the joint method leaves, and n samples
more than it fits, the posterior of L = log sigma has its peak where

    (S1)  n - S exp(-2 L) + (L - log sigma_0) / tau^2 = 0,

as the profile likelihood has sigma^2 = S / n. How much is fitted depends on sigma, so this is
repeated until it stays. The best fit itself does not, but its search ends early where noise of a
high but plausible level explains what is left: it is repeated if the found level does not. All
methods that have a likelihood then take the found level for the true one.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain

import numpy as np
import scipy

from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.estimators.shared.forward_model import game_of_point, sample_sensitivity
from olne_bench.estimators.shared.joint_problem import JointSettings, JointSolution
from olne_bench.estimators.shared.joint_starts import joint_attempts, largest_explicable, lowest
from olne_bench.games.model.game import Game
from olne_bench.games.model.simplex import theta_tangent

#: Rounds at most, and the change of log sigma that ends them.
_ROUNDS, _STILL = 5, 0.02
#: The level is within this many deviations of its prior, and so many are high but plausible.
_FARTHEST, _HIGH = 3.0, 2.0
_FLAT = 1e-12  # precision of initial states


def with_found_noise(
    problem: Problem, observations: Sequence[Observation], deadline: float
) -> Problem:
    """The problem with the most probable noise level, then known; unchanged if it was.

    Its noise is white. Searches end by the deadline, in seconds of ``time.monotonic``.
    """
    if not problem.sigma_spread:
        return problem
    found = replace(problem, sigma_spread=0.0)
    high = replace(found, sigma=problem.sigma * np.exp(_HIGH * problem.sigma_spread))
    fits = [_BestFit(high, one.y, deadline) for one in observations]
    for _ in range(_ROUNDS):
        squared, left = 0.0, 0.0
        for one, fit in zip(observations, fits, strict=True):
            squared += fit.best.objective
            left += _left(found, one.y, fit.best)
        level = most_probable_level(problem.sigma, problem.sigma_spread, squared, left)
        moved = abs(np.log(level / found.sigma))
        found = replace(found, sigma=level)
        searched = [fit.searched_again(found) for fit in fits]
        if moved < _STILL and not any(searched):
            break
    return found


def telling_noise(estimate: Estimate, asked: Problem, found: Problem) -> Estimate:
    """The estimate with the level that was found among its extras, where nobody told it."""
    if not asked.sigma_spread:
        return estimate
    return replace(estimate, extras={**estimate.extras, "sigma": found.sigma})


def with_told_noise(problem: Problem, estimate: Estimate) -> Problem:
    """The problem with the level that an estimate tells; unchanged if it was known."""
    if not problem.sigma_spread:
        return problem
    level = float(estimate.extras.get("sigma", problem.sigma))
    return replace(problem, sigma=level, sigma_spread=0.0)


def most_probable_level(median: float, spread: float, squared: float, left: float) -> float:
    """The peak (S1): median of sigma and deviation of log sigma a priori, S, and n as ``left``."""

    def slope(away: float) -> float:
        level = median * np.exp(away)
        return float(max(left, 0.0) - squared / level**2 + away / spread**2)

    reach = _FARTHEST * spread
    if slope(-reach) >= 0:
        return float(median * np.exp(-reach))
    if slope(reach) <= 0:
        return float(median * np.exp(reach))
    return float(median * np.exp(scipy.optimize.brentq(slope, -reach, reach, xtol=1e-6)))


class _BestFit:
    """What the joint method leaves of an observation (T, N, d)."""

    def __init__(self, problem: Problem, y: np.ndarray, deadline: float) -> None:
        """The first search ends early where noise of the problem's level explains a fit."""
        self._y, self._deadline = y, deadline
        self.best = self._searched(problem)
        self._explained = self._explains(problem)  # which ended the search early

    def searched_again(self, problem: Problem) -> bool:
        """Search on, once, if the search ended early and this level does not explain the fit."""
        if not self._explained or self._explains(problem):
            return False
        self.best, self._explained = self._searched(problem), False
        return True

    def _searched(self, problem: Problem) -> JointSolution:
        scale, floor = problem.noise_scale, problem.weight_floor
        settings = JointSettings(noise_scale=scale, weight_floor=floor)
        return lowest(list(joint_attempts(problem, self._y, settings, self._deadline)))

    def _explains(self, problem: Problem) -> bool:
        return self.best.objective <= largest_explicable(problem, [self._y])


def _left(problem: Problem, y: np.ndarray, fit: JointSolution) -> float:
    """Number of samples less what was fitted."""
    game, seen = game_of_point(fit.point), np.isfinite(y)
    try:
        sensitivity = sample_sensitivity(problem, game)
    except ValueError:  # a fold of equilibria: all unknowns count
        return float(seen.sum() - game.theta.size - game.initial_state.size)
    free, precision = fitted_part(problem, seen, sensitivity)
    sizes = np.linalg.svd(free / np.sqrt(precision), compute_uv=False)
    return float(len(free) - (sizes**2 / (sizes**2 + 1)).sum())


def fitted_part(
    problem: Problem, seen: np.ndarray, sensitivity: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """J (n, F) over sigma, in what may change of theta and the start, and P (F,)."""
    tangent = theta_tangent(problem.game.num_weights, problem.game.parameters.used)
    by_theta, by_start = np.split(sensitivity[seen.ravel()], [len(tangent)], axis=1)
    free = np.hstack([by_theta @ tangent, by_start]) / problem.sigma
    flat = np.full(by_start.shape[1], _FLAT)
    return free, np.concatenate([_precision(problem.game), flat])


def _precision(game: Game) -> np.ndarray:
    """(F,) of the tangent of theta: a uniform distribution of weights, standardised unknowns."""
    count = game.num_weights
    weights = [count * (count + 1.0)] * (count - 1)
    own = (weights + [1.0] * int(used.sum()) for used in game.parameters.used)
    return np.array(list(chain(*own)))
