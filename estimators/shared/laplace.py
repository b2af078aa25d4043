"""Laplace's approximation of a posterior: the covariance at its most probable point.

It is the inverse of the Fisher information plus the curvature of the prior, in theta on the tangent
of the simplex, with all initial states unknown.
"""

from collections.abc import Sequence

import numpy as np

from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.forward_model import SolvedGame, sample_sensitivity
from olne_bench.games.compiled.elimination import Elimination
from olne_bench.games.model.simplex import theta_tangent
from olne_bench.games.solve.information import of_seen


def posterior_covariance(
    problem: Problem,
    observations: Sequence[Observation],
    games: Sequence[SolvedGame],
    solver: Elimination | None,
    precision: np.ndarray,
) -> np.ndarray | None:
    """Covariance (N*(K+U), N*(K+U)) of theta under a prior.

    Args:
        problem: gives game, view and noise, which is white.
        observations: one for each trajectory.
        games: the estimated game of each, all with one theta.
        solver: the game's elimination; built if None.
        precision: (N, K) of the prior of the weights: second derivatives of minus its logarithm.
            That of standardised unknowns is one.

    Returns:
        The covariance, or None without noise, or if a game is singular.
    """
    if problem.sigma == 0:
        return None
    game, tangent = problem.game, theta_tangent(problem.game)
    whole = np.hstack([precision, np.ones((game.num_players, game.parameters.count))])
    information = tangent.T @ (whole.ravel()[:, None] * tangent)
    try:
        for observation, solved in zip(observations, games, strict=True):
            sensitivity = of_seen(sample_sensitivity(problem, solved, solver), observation.y)
            by_theta, by_start = np.split(sensitivity / problem.sigma, [len(tangent)], axis=1)
            own = by_theta @ tangent
            seen, _ = np.linalg.qr(by_start)
            own -= seen @ (seen.T @ own)  # what no change of the initial state explains
            information += own.T @ own
    except ValueError:
        return None
    return np.asarray(tangent @ np.linalg.solve(information, tangent.T))
