"""Errors and coverage of ``neural_posterior`` on draws that it was not trained on.

Usage: python scripts/learned_error.py SCENARIO [--draws N]

Weights are uniform on the simplex, starts those of the scenario. Prints a line for each view and
noise level: mean cosine errors, also of ``map`` and ``posterior``, whose prior is that of the
draws; mean energy scores of samples, how often the 95 % ellipsoid of the network's samples and
their 95 % intervals hold the truth; medians of effective sample sizes, of 1,000 points of the
network if exact games from the true start weigh them, and of 1,000 tries of ``posterior``; and
median processor times of estimates that have samples.
"""

from collections.abc import Iterator
from itertools import product
from typing import Annotated, Any

import shared
import numpy as np
import pandas as pd
import scoringrules
from noisy import noisy

from olne_bench.bench.judge.metrics.formulas import cosine_error
from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.map import Map
from olne_bench.estimators.neural_posterior import NeuralPosterior, network_of, states_of
from olne_bench.estimators.posterior import Posterior
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.charts import NormalChart
from olne_bench.estimators.shared.perturbed_fits import effective_sample_size
from olne_bench.games.model.equilibrium import Equilibrium
from olne_bench.games.solve.batch import solve_batch
from olne_bench.games.solve.olne import solve_olne

#: Noise levels of the suite ``calibration``.
SIGMAS = {"two_player": (0.01, 0.03, 0.1), "highway_overtaking": (0.005, 0.02, 0.05)}
FIRST = 700_000  # of seeds
COLUMNS = (
    *("cos neural", "cos map", "cos posterior", "cos uniform", "energy", "energy posterior"),
    *("ellipsoid", "interval", "effective", "effective posterior", "ms", "ms posterior"),
)
MEDIANS = 4  # of the last columns; means of the others
POINTS = 1000


def main(scenario: Annotated[str, sorted(SIGMAS)], draws: int = 100) -> None:
    """Draw, estimate, print."""
    print("view sigma draws", *COLUMNS, sep=" | ")
    rows = [row for seed in range(FIRST, FIRST + draws) for row in judged(scenario, seed)]
    for (view, sigma), own in pd.DataFrame(rows).groupby([0, 1], sort=False):
        numbers = own.drop(columns=[0, 1])
        means = [*numbers.mean()[:-MEDIANS], *numbers.median()[-MEDIANS:]]
        print(f"{view} {sigma:g} {len(own)}", *(f"{one:.3f}" for one in means), sep=" | ")


def judged(name: str, seed: int) -> Iterator[tuple[Any, ...]]:
    """View, noise level, and the numbers of ``COLUMNS``; nothing without an equilibrium."""
    scenario = get_scenario(name, seed, weights="dirichlet")
    weights = scenario.weights
    truth = solve_olne(scenario.game, weights, scenario.initial_state, search_far=True)
    if not truth.certificate.passed:
        return
    rng = np.random.default_rng(seed)
    rng.standard_normal(truth.states.shape)  # the noise
    for view, sigma in product(("full", "partial"), SIGMAS[name]):
        given = noisy(scenario, truth.states, sigma, view, rng=seed)
        yield view, sigma, *numbers_of(*given, truth, weights, rng)


def numbers_of(
    problem: Problem,
    seen: Observation,
    motion: Equilibrium,
    weights: np.ndarray,
    rng: np.random.Generator,
) -> tuple[float, ...]:
    """The numbers of ``COLUMNS``."""
    took, found = shared.timed(
        lambda: NeuralPosterior().estimate(problem, seen, rng=rng, budget=60.0)
    )
    best = Map().estimate(problem, seen, rng=rng, budget=60.0)
    sampled_took, sampled = shared.timed(
        lambda: Posterior().estimate(problem, seen, rng=rng, budget=120.0)
    )
    assert found.samples is not None and sampled.samples is not None
    samples, truth = found.samples.reshape(len(found.samples), -1), weights.ravel()
    inverse = np.linalg.pinv(np.cov(samples, rowvar=False), rcond=1e-9, hermitian=True)
    away = samples - samples.mean(axis=0)
    own = truth - samples.mean(axis=0)
    limit = np.quantile(np.einsum("bi,ij,bj->b", away, inverse, away), 0.95)
    low, high = np.quantile(samples, [0.025, 0.975], axis=0)
    return (
        cosine_error(found.weights, weights),
        cosine_error(best.weights, weights),
        cosine_error(sampled.weights, weights),
        cosine_error(np.full_like(weights, 1 / weights.shape[1]), weights),
        float(scoringrules.es_ensemble(truth, samples)),
        float(scoringrules.es_ensemble(truth, sampled.samples.reshape(len(sampled.samples), -1))),
        float(own @ inverse @ own <= limit),
        float(((low <= truth) & (truth <= high)).mean()),
        effective_sample_size(log_weights(problem, seen, motion, weights)),
        POINTS * sampled.extras["effective_sample_size"] / sampled.extras["fits"],
        1e3 * took,
        1e3 * sampled_took,
    )


def log_weights(
    problem: Problem, seen: Observation, motion: Equilibrium, weights: np.ndarray
) -> np.ndarray:
    """Logarithms (POINTS,) of posterior over proposal at points of the network."""
    states, rng = states_of(problem, seen), np.random.default_rng(0)
    mixtures = network_of(problem.game).mixtures(states, problem.sigma)
    parts = [one.samples(POINTS, rng) for one in mixtures]
    proposal = np.sum([q.log_density(own) for q, own in zip(mixtures, parts, strict=True)], axis=0)
    points = np.hstack(parts)
    games = solve_batch(problem.game, NormalChart.of(problem).weights(points), motion, weights)
    missed = np.where(np.isfinite(states), games.states - states, 0.0) / problem.sigma
    squares = np.square(missed).sum(axis=(1, 2, 3)) + np.square(points).sum(axis=1)
    return np.where(games.converged, -0.5 * squares - proposal, -np.inf)


if __name__ == "__main__":
    shared.command(main)
