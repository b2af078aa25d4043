"""Estimates of weights and unknown parameters against their statistical bound, at low noise.

    python scripts/parameter_bounds.py [--seeds 40] [--estimator kkt_constrained]

A line per scenario and view: the error of the weights and of the parameters, each over its bound
(Cramer-Rao, joint in weights, parameters and initial state), as a root mean square over seeds; the
largest error of any parameter from exact motion, and of any weight; and the median time over
that of the same problem in which the parameters are known. Times are of the processor.
"""

import time
from itertools import product
from typing import Annotated, Any

import shared
import numpy as np

from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.scenarios.scenario import NoEquilibriumError, Scenario
from olne_bench.envs.solved.equilibrium import certified_equilibrium
from olne_bench.estimators.bilevel import Bilevel
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.games.model.observation import VIEWS, observe
from olne_bench.games.solve.information import (
    deviations_of,
    joint_weight_covariance,
    observation_sensitivity,
    of_weights,
)

ESTIMATORS: dict[str, type[KktConstrained | Bilevel]] = {
    "kkt_constrained": KktConstrained,
    "bilevel": Bilevel,
}
#: Scenario, options, and a low level of noise.
CASES: tuple[tuple[str, dict[str, Any], float], ...] = (
    ("unknown_goals", {}, 0.003),
    ("intersection", {"unknown_speeds": True}, 0.003),
    ("two_way", {"unknown_speeds": True}, 0.003),
)


def main(seeds: int = 40, estimator: Annotated[str, ESTIMATORS] = "kkt_constrained") -> None:
    """Measure and print."""
    print(
        "scenario        view     seeds  weights/bound  parameters/bound  exact: weight  "
        "parameter  time"
    )
    for (name, own, sigma), view in product(CASES, ("full", "partial")):
        print_case(name, own, sigma, view, estimator, seeds)


def print_case(
    name: str, options: dict[str, Any], sigma: float, view: str, estimator: str, seeds: int
) -> None:
    """One line of the table."""
    errors, bounds, exact, times = [], [], [], []
    for seed in range(seeds):
        try:
            scenario = get_scenario(name, seed, **options)
            truth = certified_equilibrium(scenario)
        except NoEquilibriumError:
            continue
        method = ESTIMATORS[estimator]()
        found, own_time = run(scenario, truth.states, method, view, sigma, seed)
        clean, _ = run(scenario, truth.states, method, view, 0.0, seed)
        _, plain_time = run(scenario, truth.states, method, view, sigma, seed, known=True)
        errors.append(squares(scenario, found))
        bounds.append(bound_of(scenario, truth, view, sigma))
        exact.append(np.sqrt(largest(scenario, clean)))
        times.append(own_time / plain_time)
    ratio = np.sqrt(np.mean(np.divide(errors, bounds), axis=0))
    worst = np.max(exact, axis=0)
    print(
        f"{name:15} {view:8} {len(errors):5} {ratio[0]:14.2f} {ratio[1]:17.2f} {worst[0]:14.1e} "
        f"{worst[1]:10.1e} {np.median(times):5.2f}",
        flush=True,
    )


def run(
    scenario: Scenario,
    states: np.ndarray,
    method: KktConstrained | Bilevel,
    view: str,
    sigma: float,
    seed: int,
    *,
    known: bool = False,
) -> tuple[Estimate, float]:
    """An estimate, and the seconds that it took."""
    model, game = VIEWS[view], scenario.game if known else scenario.told
    noise = np.random.default_rng(seed).standard_normal(states.shape)
    noisy = states + sigma * np.array(scenario.noise_scale) * noise
    scale = model.noise_scale(np.array(scenario.noise_scale), game.dynamics)
    problem = Problem(game, model, sigma, noise_scale=tuple(map(float, scale)))
    observation = Observation(observe(model, game.dynamics, noisy))
    method.warm_up(problem)
    started = time.process_time()
    found = method.estimate(problem, observation, rng=np.random.default_rng(seed), budget=120.0)
    return found, time.process_time() - started


def squares(scenario: Scenario, found: Estimate) -> tuple[float, float]:
    """Sums of squared errors of weights, and of parameters over their priors' deviations."""
    assert found.parameters is not None
    assert scenario.parameters is not None
    scaled = (found.parameters - scenario.parameters) / scenario.told.parameters.deviations
    return float(np.sum((found.weights - scenario.weights) ** 2)), float(np.nansum(scaled**2))


def largest(scenario: Scenario, found: Estimate) -> tuple[float, float]:
    """Largest squared error of a weight, and of a parameter in its unit."""
    assert found.parameters is not None
    assert scenario.parameters is not None
    return (
        float(np.max((found.weights - scenario.weights) ** 2)),
        float(np.nanmax((found.parameters - scenario.parameters) ** 2)),
    )


def bound_of(scenario: Scenario, truth: Any, view: str, sigma: float) -> tuple[float, float]:
    """Traces of the bound of weights, and of parameters over their priors' deviations."""
    game, model = scenario.told, VIEWS[view]
    scale = model.noise_scale(np.array(scenario.noise_scale), game.dynamics)
    sensitivity = observation_sensitivity(
        game,
        model,
        truth.states,
        truth.controls,
        truth.costates,
        scenario.theta,
        noise_scale=scale,
    )
    covariance = joint_weight_covariance(game, [sensitivity])
    if covariance is None:
        raise SystemExit(f"{scenario.name!r} is not identifiable in the view {view!r}")
    covariance = sigma**2 * covariance
    weights, deviations = of_weights(game, covariance), deviations_of(game, covariance)
    assert weights is not None
    assert deviations is not None
    return (
        float(np.trace(weights)),
        float(np.nansum((deviations / game.parameters.deviations) ** 2)),
    )


if __name__ == "__main__":
    shared.command(main)
