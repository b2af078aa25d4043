"""Turns any noise into white noise, the first step of an estimator.

With W C W' = 1, observing h(x) with noise of covariance sigma^2 C is observing W h(x), as W y, with
independent noise of standard deviation sigma. A player's sample then counts as missing if any of
its components is, as the others have another covariance. Independent components keep their scales.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from olne_bench.estimators.protocol import Observation, Problem, check_observations
from olne_bench.games.model.observation import WhitenedView, whitening

#: Standard deviation of the noise, relative to its scale, that noise-free observations are given.
_LEAST_SIGMA = 1e-4


def assumed_sigma(problem: Problem) -> float:
    """The noise level, which is never zero where something is divided by it."""
    return max(problem.sigma, _LEAST_SIGMA)


def white_problem(problem: Problem) -> Problem:
    """The equivalent problem in which the noise on each component is independent."""
    if problem.noise_covariance is None:
        return problem
    matrix = tuple(tuple(float(v) for v in row) for row in whitening(problem.noise_covariance))
    view = WhitenedView(problem.view, matrix)
    return replace(problem, view=view, noise_scale=(), noise_covariance=None)


def with_white_noise(
    problem: Problem, observation: Observation | Sequence[Observation]
) -> tuple[Problem, tuple[Observation, ...]]:
    """The problem with independent noise, observations in float64; as ``check_observations``."""
    observations = check_observations(problem, observation)
    matrix = None
    if problem.noise_covariance is not None:
        matrix = whitening(problem.noise_covariance)
    return white_problem(problem), tuple(
        Observation(
            y=_white(one.y, matrix), extra=None if one.extra is None else _white(one.extra, matrix)
        )
        for one in observations
    )


def _white(y: np.ndarray, matrix: np.ndarray | None) -> np.ndarray:
    y = np.ascontiguousarray(y, dtype=np.float64)
    return y if matrix is None else np.ascontiguousarray(y @ matrix.T)
