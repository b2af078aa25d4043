"""The distance that vehicles of `merging` keep, estimated beside their weights.

    python scripts/unknown_radius.py [--seeds 50] [--estimator kkt_constrained] [--views full]

A line per view. Draws count where contact is active at the truth: the multiplier of some distance
exceeds its margin. Of these, at sigma = 0.005: the median and the largest relative error of the
distance, the share of draws within 2 %, and the root mean square of errors over what their
deviations say. From exact motion: the largest error of the distance [m], and the number of draws
whose weights are all within 1e-5. Last, the median time of the processor, and that of the same
problem with a known distance.
"""

import time
from collections.abc import Callable
from typing import Annotated

import shared
import numpy as np

from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.scenarios.scenario import NoEquilibriumError, Scenario
from olne_bench.envs.solved.equilibrium import certified_equilibrium
from olne_bench.estimators.bilevel import Bilevel
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.estimators.ukf import Ukf
from olne_bench.games.model.equilibrium import Equilibrium
from olne_bench.games.model.observation import VIEWS, observe

SIGMA, CLOSE, EXACT = 0.005, 0.02, 1e-5
ESTIMATORS: dict[str, Callable[[], KktConstrained | Bilevel | Ukf]] = {
    "kkt_constrained": KktConstrained,
    "bilevel": Bilevel,
    "ukf": Ukf,
}


def main(
    seeds: int = 50,
    estimator: Annotated[str, ESTIMATORS] = "kkt_constrained",
    views: tuple[Annotated[str, VIEWS], ...] = ("full", "partial"),
) -> None:
    """Measure and print."""
    print(
        "view     draws  contact  median  largest  within 2 %  over deviation  exact: distance"
        "  weights   time  known"
    )
    drawn = draws(seeds)
    touching = [(seed, scenario, truth) for seed, scenario, truth in drawn if truth.active.any()]
    for view in views:
        errors, scaled, exact, times = [], [], [], []
        for seed, scenario, truth in touching:
            method = ESTIMATORS[estimator]()
            found, own_time = run(scenario, truth, method, view, SIGMA, seed)
            _, known_time = run(scenario, truth, method, view, SIGMA, seed, known=True)
            error, deviation = distance_of(scenario, found)
            errors.append(abs(error) / true_distance(scenario))
            scaled.append(error / deviation)
            times.append((own_time, known_time))
            if estimator != "ukf":  # a filter needs noise
                clean, _ = run(scenario, truth, method, view, 0.0, seed)
                largest = np.abs(clean.weights - scenario.weights).max()
                exact.append((abs(distance_of(scenario, clean)[0]), largest))
        far = max((distance for distance, _ in exact), default=np.nan)
        good = sum(weight < EXACT for _, weight in exact)
        spent = np.median(times, axis=0)
        print(
            f"{view:8} {len(drawn):5} {len(touching):8} {100 * np.median(errors):6.2f}% "
            f"{100 * max(errors):7.2f}% {np.mean(np.array(errors) <= CLOSE):11.0%} "
            f"{np.sqrt(np.mean(np.square(scaled))):15.2f} {far:16.1e} {good:8} "
            f"{spent[0]:5.2f}s {spent[1]:5.2f}s",
            flush=True,
        )


def draws(seeds: int) -> list[tuple[int, Scenario, Equilibrium]]:
    """All feasible draws and their true motion."""
    found = []
    for seed in range(seeds):
        try:
            scenario = get_scenario("merging", seed, weights="moderate", unknown_radius=True)
            found.append((seed, scenario, certified_equilibrium(scenario)))
        except NoEquilibriumError:
            continue
    return found


def run(
    scenario: Scenario,
    truth: Equilibrium,
    method: KktConstrained | Bilevel | Ukf,
    view: str,
    sigma: float,
    seed: int,
    *,
    known: bool = False,
) -> tuple[Estimate, float]:
    """An estimate, and the seconds that it took."""
    problem = Problem(scenario.game if known else scenario.told, VIEWS[view], sigma)
    noise = np.random.default_rng(seed).standard_normal(truth.states.shape)
    y = observe(problem.view, problem.game.dynamics, truth.states + sigma * noise)
    method.warm_up(problem)
    started = time.process_time()
    found = method.estimate(problem, Observation(y), rng=np.random.default_rng(seed), budget=600.0)
    return found, time.process_time() - started


def true_distance(scenario: Scenario) -> float:
    """In metres."""
    assert scenario.parameters is not None
    return float(scenario.parameters[0, 0])


def distance_of(scenario: Scenario, found: Estimate) -> tuple[float, float]:
    """Error of the distance and its standard deviation [m], NaN where there is none."""
    assert found.parameters is not None
    deviations = found.parameter_deviations
    deviation = np.nan if deviations is None else float(deviations[0, 0])
    return float(found.parameters[0, 0]) - true_distance(scenario), deviation


if __name__ == "__main__":
    shared.command(main)
