"""How certain estimates are: covariances of theta at an optimum."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.forward_model import SolvedGame, sample_sensitivity
from olne_bench.estimators.shared.white_noise import assumed_sigma
from olne_bench.games.compiled.elimination import Elimination
from olne_bench.games.model.simplex import theta_tangent
from olne_bench.games.solve.information import (
    in_theta,
    joint_weight_covariance,
    of_seen,
    unobserved_unknowns,
)


@dataclass(frozen=True)
class Certainty:
    """How well the observations tell the maximum-likelihood theta."""

    #: (N*(K+U), N*(K+U)) of theta: inverse Fisher information. None if theta is not
    #: identifiable or sigma is 0.
    covariance: np.ndarray | None
    #: One line that names the unknowns about which nothing was seen; empty if there are none.
    #: Their variance is that of the prior.
    unobserved: str = ""

    def message(self, said: str) -> str:
        """What there is to say, besides what is said already."""
        return "; ".join(filter(None, [said, self.unobserved]))


def likelihood_certainty(
    problem: Problem,
    observations: Sequence[Observation],
    games: Sequence[SolvedGame],
    solver: Elimination | None = None,
    *,
    prior: bool = False,
) -> Certainty:
    """The inverse Fisher information at the estimate, as if no weight were at its floor.

    There is one observation and one estimated game for each trajectory. ``prior`` adds the
    information of the unknowns' priors; the elimination is built if None.
    """
    asked = problem.game
    if problem.sigma == 0 and not asked.parameters.count:
        return Certainty(None)
    try:
        sensitivities = [
            of_seen(sample_sensitivity(problem, game, solver), one.y)
            for one, game in zip(observations, games, strict=True)
        ]
    except ValueError:
        return Certainty(None)
    unobserved = unobserved_unknowns(asked, sensitivities, sigma=assumed_sigma(problem))
    named = ", ".join(asked.describe_unknown(i, k) for i, k in np.argwhere(unobserved))
    message = f"nothing that was seen depends on {named}" if named else ""
    if problem.sigma == 0:
        return Certainty(None, message)
    if prior:
        covariance = joint_weight_covariance(asked, sensitivities, prior_scale=problem.sigma)
    else:
        covariance = joint_weight_covariance(asked, sensitivities, unobserved=unobserved)
    if covariance is None:
        return Certainty(None, message)
    covariance = problem.sigma**2 * covariance
    if not prior:
        covariance += np.diag(in_theta(asked, unobserved).astype(float))
    return Certainty(covariance, message)


def posterior_covariance(
    problem: Problem,
    observations: Sequence[Observation],
    games: Sequence[SolvedGame],
    solver: Elimination | None,
    precision: np.ndarray,
) -> np.ndarray | None:
    """Laplace's approximation: covariance (N*(K+U), N*(K+U)) of theta at its most probable value.

    It is the inverse of the Fisher information plus the curvature of the prior, on the tangent of
    the simplex, with all initial states unknown: ``precision`` (N, K) for weights, minus second
    derivatives of its logarithm; one for standardised unknowns. The noise is white, and the games
    of all trajectories have one theta. None without noise, or if a game is singular.
    """
    if problem.sigma == 0:
        return None
    game = problem.game
    tangent = theta_tangent(game.num_weights, game.parameters.used)
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
