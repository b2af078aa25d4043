"""Errors and coverage of ``neural_posterior`` on draws that it was not trained on, beside ``map``.

Usage: python scripts/learned_error.py SCENARIO [--draws N]

Weights are uniform on the simplex, starts those of the scenario. Prints a line for each view and
noise level: mean cosine errors, the mean energy score of samples, how often the 95 % ellipsoid of
the samples and their 95 % intervals hold the truth, and the median time of an estimate.
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
from olne_bench.estimators.neural_posterior import NeuralPosterior
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.games.solve.olne import solve_olne

#: Noise levels of the suite ``calibration``.
SIGMAS = {"two_player": (0.01, 0.03, 0.1), "highway_overtaking": (0.005, 0.02, 0.05)}
FIRST = 700_000  # of seeds
COLUMNS = ("cos neural", "cos map", "cos uniform", "energy", "ellipsoid", "interval", "ms")


def main(scenario: Annotated[str, sorted(SIGMAS)], draws: int = 100) -> None:
    """Draw, estimate, print."""
    print("view sigma draws", *COLUMNS, sep=" | ")
    rows = [row for seed in range(FIRST, FIRST + draws) for row in judged(scenario, seed)]
    for (view, sigma), own in pd.DataFrame(rows).groupby([0, 1], sort=False):
        numbers = own.drop(columns=[0, 1])
        means = [*numbers.mean()[:-1], numbers.median().iloc[-1]]
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
        yield view, sigma, *numbers_of(*given, weights, rng)


def numbers_of(
    problem: Problem, seen: Observation, weights: np.ndarray, rng: np.random.Generator
) -> tuple[float, ...]:
    """The numbers of ``COLUMNS``."""
    began = shared.clock()
    found = NeuralPosterior().estimate(problem, seen, rng=rng, budget=60.0)
    took = shared.clock()[1] - began[1]
    best = Map().estimate(problem, seen, rng=rng, budget=60.0)
    assert found.samples is not None, "the network knows these scenarios"
    samples, truth = found.samples.reshape(len(found.samples), -1), weights.ravel()
    inverse = np.linalg.pinv(np.cov(samples, rowvar=False), rcond=1e-9, hermitian=True)
    away = samples - samples.mean(axis=0)
    own = truth - samples.mean(axis=0)
    limit = np.quantile(np.einsum("bi,ij,bj->b", away, inverse, away), 0.95)
    low, high = np.quantile(samples, [0.025, 0.975], axis=0)
    return (
        cosine_error(found.weights, weights),
        cosine_error(best.weights, weights),
        cosine_error(np.full_like(weights, 1 / weights.shape[1]), weights),
        float(scoringrules.es_ensemble(truth, samples)),
        float(own @ inverse @ own <= limit),
        float(((low <= truth) & (truth <= high)).mean()),
        1e3 * took,
    )


if __name__ == "__main__":
    shared.command(main)
