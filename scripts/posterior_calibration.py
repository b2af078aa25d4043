"""Whether posterior samples are calibrated: truths from the prior, one line per sensor and noise.

    python scripts/posterior_calibration.py two_player --draws 170
    python scripts/posterior_calibration.py highway_overtaking --draws 50 --sigmas 0.005 0.02

Every draw has weights, a start and noise of its own (``posterior_draws``), and is used once: a
weight that nothing shows is as far out at one noise level as at all others. The 95 % region holds
the samples that are nearest to their mean, in Mahalanobis distance of log-ratios: its limit is a
quantile of the distances among the samples. The rank of a true weight among its samples is uniform
if the posterior is right (simulation-based calibration: Talts et al. 2018); the p after Holm's
correction is the least over all weights. Draws that did not converge count like all others.

The column "control" says how many draws the score test at the truth holds at the same level. It
depends on the noise alone, and its distribution is exact: where it is far from 95 %, so is luck.
"""

from itertools import product
from typing import Annotated, Any

import shared
import numpy as np
from posterior_draws import SIGMAS, Draw, PosteriorOfDraws
from posterior_draws import draws as drawn
from scipy.special import chdtri
from scipy.stats import binomtest, chisquare
from tqdm import tqdm

from olne_bench.bench.judge.metrics.formulas import cosine_error
from olne_bench.envs.recordings.recording import Recording
from olne_bench.estimators.protocol import Problem
from olne_bench.estimators.shared.forward_model import (
    SolvedGame,
    expected_samples,
    sample_sensitivity,
    scaled_samples,
)
from olne_bench.games.model.observation import VIEWS
from olne_bench.games.model.simplex import theta_tangent
from olne_bench.games.solve.information import of_seen

LEVEL = 0.95
BINS = 10  # of the ranks' histogram
MARGINAL_LEVELS = (0.5, 0.8, 0.95)
Outcome = dict[str, Any]


def main(
    scenario: Annotated[str, SIGMAS],
    draws: int = 1000,
    first: int = 0,
    views: tuple[Annotated[str, sorted(VIEWS)], ...] = ("full", "partial"),
    sigmas: tuple[float, ...] = (),
    flat: bool = False,
) -> None:
    """Command line."""
    cells = list(product(views, sigmas or SIGMAS[scenario]))
    known = [
        list(drawn(scenario, range(start, start + draws)))
        for start in range(first, first + len(cells) * draws, draws)
    ]
    if not all(known):
        raise SystemExit(f"no draw of {scenario} has a certified equilibrium")
    number = sum(map(len, known))
    print(f"{scenario}: {number} of {len(cells) * draws} draws are certified")
    print(_TITLES)
    every: list[Outcome] = []
    for (view, sigma), some in zip(cells, known, strict=True):
        bar = tqdm(some, disable=None, leave=False)
        outcomes = [_outcome(one, view, sigma, flat=flat) for one in bar]
        print(f"{view:8}{sigma:7g}" + _line(outcomes), flush=True)
        every += outcomes
    print(f"{'all':15}" + _line(every))


def _outcome(draw: Draw, view: str, sigma: float, *, flat: bool) -> Outcome:
    """One draw.

    Whether the region holds the truth, and whether the score test at the truth does not refuse it;
    ranks (N, K): the share of the samples below each true weight.
    """
    truth = draw.recording.scenario.weights
    problem, seen = draw.seen(view, sigma)
    estimator = PosteriorOfDraws(start=None if flat else draw.start)
    estimator.warm_up(problem)
    rng = np.random.default_rng(draw.seed)
    seconds, found = shared.timed(estimator.estimate, problem, seen, rng=rng, budget=600.0)
    truth = truth / truth.sum(axis=1, keepdims=True)
    samples = found.samples
    return {
        "error": cosine_error(truth, found.weights),
        "covered": samples is not None and covers(samples, truth),
        "control": _control(problem, draw.recording, seen.y),
        "ranks": truth * np.nan if samples is None else (samples < truth).mean(axis=0),
        "effective": found.extras.get("effective_sample_size", 0.0),
        "r_hat": found.extras.get("split_r_hat", np.inf),
        "converged": found.converged,
        "seconds": seconds,
    }


def _control(problem: Problem, recording: Recording, y: np.ndarray) -> bool:
    """Whether noise has no more than its 95 % quantile in the directions of the weights."""
    game, truth = problem.game, recording.scenario.weights
    truth = truth / truth.sum(axis=1, keepdims=True)
    rows = of_seen(sample_sensitivity(problem, SolvedGame(recording.root, truth)), y)
    by_theta, by_start = np.split(rows, [truth.size], axis=1)
    tangent = by_theta @ theta_tangent(game.num_weights, game.parameters.used)
    start = np.linalg.qr(by_start)[0]
    own = np.linalg.qr(tangent - start @ (start.T @ tangent))[0]
    noise = scaled_samples(problem, y) - expected_samples(problem, recording.states)
    noise = noise.ravel()[np.isfinite(noise.ravel())] / problem.sigma
    return bool(np.sum((own.T @ noise) ** 2) <= chdtri(own.shape[1], 1 - LEVEL))


def covers(samples: np.ndarray, truth: np.ndarray) -> bool:
    """Whether the 95 % region of samples (M, N, K) holds the truth (N, K)."""
    ratios, true_ratios = (
        np.log(weights[..., :-1] / weights[..., -1:]).reshape(*weights.shape[:-2], -1)
        for weights in (samples, truth)
    )
    mean, spread = ratios.mean(axis=0), np.cov(ratios, rowvar=False)
    inverse = np.linalg.pinv(spread)
    distances = np.einsum("mi,ij,mj->m", ratios - mean, inverse, ratios - mean)
    own = (true_ratios - mean) @ inverse @ (true_ratios - mean)
    return bool(own <= np.quantile(distances, LEVEL))


_TITLES = (
    f"{'view':8}{'sigma':>7}{'draws':>7}{'error':>8}{'covered % [95 % interval]':>27}"
    f"{'control':>9}"
    f"{'weights at 50, 80, 95 %':>25}{'least p':>9}{'ESS 5 %':>9}{'median':>8}"
    f"{'R-hat 95 %':>12}{'poor %':>8}{'s median':>10}{'95 %':>7}"
)


def _line(outcomes: list[Outcome]) -> str:
    """The columns of some draws."""
    of = {name: np.array([one[name] for one in outcomes]) for name in outcomes[0]}
    interval = binomtest(int(of["covered"].sum()), len(outcomes)).proportion_ci()
    low, high = 100 * interval.low, 100 * interval.high
    share = f"{100 * of['covered'].mean():.1f} [{low:.1f}, {high:.1f}]"
    ranks = of["ranks"].reshape(len(outcomes), -1)
    within = [100 * np.mean(np.abs(ranks - 0.5) <= level / 2) for level in MARGINAL_LEVELS]
    return (
        f"{len(outcomes):7}{of['error'].mean():8.4f}{share:>27}{100 * of['control'].mean():9.1f}"
        f"{'  '.join(f'{value:.1f}' for value in within):>25}{least_p(ranks):9.3f}"
        f"{np.quantile(of['effective'], 0.05):9.0f}{np.median(of['effective']):8.0f}"
        f"{np.quantile(of['r_hat'], 0.95):12.3f}{100 * (1 - of['converged'].mean()):8.1f}"
        f"{np.median(of['seconds']):10.2f}{np.quantile(of['seconds'], 0.95):7.2f}"
    )


def least_p(ranks: np.ndarray) -> float:
    """The least p after Holm's correction that ranks (draws, weights) are uniform."""
    known = ranks[np.isfinite(ranks).all(axis=1)]
    places = np.minimum((known * BINS).astype(int), BINS - 1)
    counts = [np.bincount(column, minlength=BINS) for column in places.T]
    return float(min(1.0, len(counts) * min(chisquare(one).pvalue for one in counts)))


if __name__ == "__main__":
    shared.command(main)
