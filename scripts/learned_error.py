"""Errors and coverage of ``neural_posterior`` on draws that it was not trained on, beside ``map``.

Usage: python scripts/learned_error.py SCENARIO [--draws N]

Weights are uniform on the simplex, starts those of the scenario. Prints a line for each view and
noise level: mean cosine errors, the mean energy score of samples, how often the 95 % ellipsoid of
the samples and their 95 % intervals hold the truth, and the median time of an estimate.
"""

import time
from collections.abc import Iterator
from typing import Annotated

import shared
import numpy as np
import scoringrules

from olne_bench.bench.judge.metrics.formulas import cosine_error
from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.map import Map
from olne_bench.estimators.neural_posterior import NeuralPosterior
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.games.model.observation import VIEWS, observe
from olne_bench.games.solve.olne import solve_olne

#: Noise levels of the suite ``calibration``.
SIGMAS = {"two_player": (0.01, 0.03, 0.1), "highway_overtaking": (0.005, 0.02, 0.05)}
FIRST = 700_000  # of seeds
COLUMNS = ("cos neural", "cos map", "cos uniform", "energy", "ellipsoid", "interval", "ms")


def main(scenario: Annotated[str, sorted(SIGMAS)], draws: int = 100) -> None:
    """Draw, estimate, print."""
    print("view sigma draws", *COLUMNS, sep=" | ")
    found: dict[tuple[str, float], list[tuple[float, ...]]] = {}
    for seed in range(FIRST, FIRST + draws):
        for key, numbers in judged(scenario, seed):
            found.setdefault(key, []).append(numbers)
    for (view, sigma), rows in found.items():
        means = [*np.mean(rows, axis=0)[:-1], np.median(rows, axis=0)[-1]]
        print(f"{view} {sigma:g} {len(rows)}", *(f"{one:.3f}" for one in means), sep=" | ")


def judged(name: str, seed: int) -> Iterator[tuple[tuple[str, float], tuple[float, ...]]]:
    """View and noise level, and the numbers of ``COLUMNS``; nothing without an equilibrium."""
    scenario = get_scenario(name, seed, weights="dirichlet")
    game, weights = scenario.game, scenario.weights
    truth = solve_olne(game, weights, scenario.initial_state, search_far=True)
    if not truth.certificate.passed:
        return
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal(truth.states.shape)
    for view in ("full", "partial"):
        for sigma in SIGMAS[name]:
            seen = observe(VIEWS[view], game.dynamics, truth.states + sigma * noise)
            problem = Problem(game, VIEWS[view], sigma)
            yield (view, sigma), numbers_of(problem, Observation(seen), weights, rng)


def numbers_of(
    problem: Problem, seen: Observation, weights: np.ndarray, rng: np.random.Generator
) -> tuple[float, ...]:
    """The numbers of ``COLUMNS``."""
    begin = time.perf_counter()
    found = NeuralPosterior().estimate(problem, seen, rng=rng, budget=60.0)
    took = time.perf_counter() - begin
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
