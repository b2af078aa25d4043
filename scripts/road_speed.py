"""Time of processor on HighwayEnv's roads: one more draw, and trials of estimators.

    python scripts/road_speed.py [--draws 10] [--trials 2] [--estimators kkt_constrained ukf ...]

First a line per road on draws: number of players, median and largest time until the game is ready,
solved and certified locally, and how many are. Each road's first draw, which compiles its solver,
is not counted. Then a line per road and estimator: median and largest time of a trial, over draws,
two levels of noise and both views, how many converged, and the median cosine error. Building
solvers (``warm_up``) is not counted, as in a run.
"""

from functools import partial
from itertools import product
from typing import Annotated

import shared
import numpy as np

from olne_bench.bench.judge.metrics.formulas import cosine_error
from olne_bench.envs.scenarios import (
    get_scenario,
    highway,
    intersection,
    merge,
    roundabout,
    two_way,
)
from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.particle import Particle
from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.estimators.ukf import Ukf
from olne_bench.games.model.observation import VIEWS, observe
from olne_bench.games.solve.olne import solve_olne

ROADS = {
    "highway": (highway.propose, 5),
    "merge": (merge.propose, 5),
    "two_way": (two_way.propose, 5),
    "roundabout": (roundabout.propose, 4),
    "intersection": (intersection.propose, 4),
}
ESTIMATORS: dict[str, type[KktConstrained | Ukf | Particle]] = {
    "kkt_constrained": KktConstrained,
    "ukf": Ukf,
    "particle": Particle,
}
SIGMAS = (0.1, 0.5)
BUDGET = 120.0  # [s]


def main(
    draws: int = 10,
    trials: int = 2,
    estimators: tuple[Annotated[str, ESTIMATORS], ...] = tuple(ESTIMATORS),
) -> None:
    """Measure and print."""
    print("road          N  median ms  largest ms  certified")
    for name in ROADS:
        print_draws(name, draws)
    print("road         estimator         N  median ms  largest ms  converged  cosine error")
    for name, estimator in product(ROADS, estimators):
        print_trials(name, estimator, trials)


def print_draws(name: str, draws: int) -> None:
    """Time the draws after the first."""
    propose, players = ROADS[name]
    times, certified = [], 0
    for seed in range(draws + 1):
        scenario = propose(np.random.default_rng([seed, players, 0]), players)
        start = scenario.game, scenario.weights, scenario.initial_state
        seconds, found = shared.timed(partial(solve_olne, *start))
        times.append(1e3 * seconds)
        certified += bool(seed and found.certificate.passed)
    median, largest = np.median(times[1:]), max(times[1:])
    print(
        f"{name:12} {players:2} {median:10.1f} {largest:11.1f}  {certified} of {draws}", flush=True
    )


def print_trials(name: str, estimator: str, draws: int) -> None:
    """Time the trials of one estimator on one road."""
    times, converged, errors, players = [], 0, [], 0
    for seed, sigma, view in product(range(draws), SIGMAS, VIEWS):
        scenario = get_scenario(name, seed)
        players = scenario.game.num_players
        milliseconds, estimate = run_trial(scenario, estimator, sigma, view, seed)
        times.append(milliseconds)
        converged += estimate.converged
        errors.append(cosine_error(estimate.weights, scenario.weights))
    print(
        f"{name:12} {estimator:16} {players:2} {np.median(times):10.1f} {max(times):11.1f}  "
        f"{converged} of {len(times)}  {np.median(errors):12.4f}",
        flush=True,
    )


def run_trial(
    scenario: Scenario, estimator: str, sigma: float, view: str, seed: int
) -> tuple[float, Estimate]:
    """One trial, in milliseconds of processor time; solvers are built before."""
    game, model = scenario.game, VIEWS[view]
    truth = solve_olne(game, scenario.weights, scenario.initial_state)
    noise = np.random.default_rng(seed).standard_normal(truth.states.shape)
    noisy = truth.states + sigma * np.array(scenario.noise_scale) * noise
    scale = model.noise_scale(np.array(scenario.noise_scale), game.dynamics)
    problem = Problem(game, model, sigma, noise_scale=tuple(map(float, scale)))
    method = ESTIMATORS[estimator]()
    method.warm_up(problem)
    observation = Observation(observe(model, game.dynamics, noisy))
    rng = np.random.default_rng(seed)
    seconds, estimate = shared.timed(
        lambda: method.estimate(problem, observation, rng=rng, budget=BUDGET)
    )
    return 1e3 * seconds, estimate


if __name__ == "__main__":
    shared.command(main)
