"""The likelihood ratio of an estimate against the truth, computed by the referee."""

import numpy as np

from olne_bench.envs.recordings.recording import Recording
from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.estimators.shared.forward_model import SolvedGame, game_at
from olne_bench.estimators.shared.outer_fit import HeldWeights, least_error, least_error_in
from olne_bench.estimators.shared.white_noise import with_white_noise
from olne_bench.games.solve.newton import Root
from olne_bench.games.solve.root_following import follow_root


def likelihood_ratio(
    problem: Problem,
    observations: tuple[Observation, ...],
    recordings: tuple[Recording, ...],
    estimate: Estimate,
    found: Root,
) -> float | None:
    """Twice the log of the largest likelihood less that of the true weights.

    The largest one is that of the optimum to which the estimate leads: an estimate that is not an
    optimum gets no larger region for that. Where no fit is found from there, as its weights may
    have an equilibrium far from what was seen, it is that to which the truth leads. At the true
    weights, initial states and unknowns are fitted. The estimate's own error counts where it is
    less than what is found: who claims more than can be found gets a smaller region.

    Args:
        problem: what the estimator was told.
        observations: one for each trajectory.
        recordings: the true motion of each.
        estimate: the estimate; its ``objective`` is the sum of squared errors.
        found: the forward game at the estimate, from the first recording's start.

    Returns:
        None if no fit is found at the true weights, or neither near the estimated ones nor from
        the truth.
    """
    white, seen = with_white_noise(problem, observations)
    scenario = recordings[0].scenario
    theta, true_theta = estimate.theta(problem.game), scenario.theta
    others = [follow_root(problem.game, one.root, true_theta, theta) for one in recordings[1:]]
    roots = [found, *(root for root in others if root is not None)]
    if len(roots) < len(recordings):
        return None
    truth = _games(white, [one.root for one in recordings], true_theta)
    held = least_error_in(white, seen, truth, HeldWeights(truth[0].weights))
    if held is None:
        return None
    at_truth, fitted = held
    at_best = least_error(white, seen, _games(white, roots, theta), held=False)
    if at_best is None:
        at_best = least_error(white, seen, fitted, held=False)
    if at_best is None:
        return None
    claimed = estimate.extras.get("objective", np.inf)
    return float((at_truth - min(at_best, claimed)) / problem.sigma**2)


def _games(problem: Problem, roots: list[Root], theta: np.ndarray) -> tuple[SolvedGame, ...]:
    return tuple(game_at(problem.game, root, theta) for root in roots)
