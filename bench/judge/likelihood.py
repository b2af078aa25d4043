"""Ratios of an estimate against the truth, which the referee computes: how far out the truth is."""

import numpy as np

from olne_bench.envs.recordings.recording import Recording
from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.estimators.shared.fit_test import peak_near
from olne_bench.estimators.shared.forward_model import SolvedGame, game_at
from olne_bench.estimators.shared.noise_level import with_told_noise
from olne_bench.estimators.shared.outer_fit import HeldWeights, least_error, least_error_in
from olne_bench.estimators.shared.posterior_density import climbed, density_near
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

    The largest one is that of the optimum to which the estimate leads, or else the truth: an
    estimate that is not an optimum gets no larger region for that. At the true weights, initial
    states and unknowns are fitted. The estimate's own error, its ``objective``, counts where it is
    less than what is found: who claims more than can be found gets a smaller region.

    ``found`` is the forward game at the estimate, from the first recording's start. None if no fit
    is found at the true weights, or neither near the estimated ones nor from the truth.
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
    best = min(at_best, estimate.extras.get("objective", np.inf))
    if problem.sigma_spread:  # its profile has sigma^2 = error / samples
        samples = sum(int(np.isfinite(one.y).sum()) for one in seen)
        return float(samples * np.log(at_truth / best)) if best > 0 else None
    return float((at_truth - best) / problem.sigma**2)


def posterior_ratio(
    problem: Problem,
    observation: Observation,
    recording: Recording,
    estimate: Estimate,
    found: Root,
) -> float | None:
    """Twice the log of the posterior's peak less its profile at the true weights.

    The density is that of ``posterior`` (B1), in coordinates in which the problem's prior is
    standard normal. The peak is the higher one of those to which estimate and truth lead. ``found``
    is the forward game at the estimate. None at a fold of equilibria.
    """
    white, (seen,) = with_white_noise(problem, (observation,))
    white = with_told_noise(white, estimate)
    true_game = game_at(problem.game, recording.root, recording.scenario.theta)
    density = density_near(white, seen, true_game.initial_state)
    truth = density.place(true_game)
    if not truth.possible[0]:
        return None
    try:
        held = climbed(density, truth, slice(density.chart.free, None))
        peaks = [climbed(density, held)]
        own = peak_near(white, seen, game_at(problem.game, found, estimate.theta(problem.game)))
    except np.linalg.LinAlgError:
        return None
    peaks += [] if own is None else [own]
    top = max(float(peak.log_density[0]) for peak in peaks)
    return 2 * (top - float(held.log_density[0]))


def _games(problem: Problem, roots: list[Root], theta: np.ndarray) -> tuple[SolvedGame, ...]:
    return tuple(game_at(problem.game, root, theta) for root in roots)
