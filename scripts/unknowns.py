"""Unknown parameters beside weights: how well estimators find them.

python scripts/unknowns.py bounds [--seeds 40] [--estimator kkt_constrained]
python scripts/unknowns.py radius [--seeds 50] [--estimator kkt_constrained] [--views full]
"""

from itertools import product
from typing import Annotated, Any

import shared
import numpy as np
from noisy import noisy

from olne_bench.bench.judge.observe import sensor_model
from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.scenarios.scenario import NoEquilibriumError, Scenario
from olne_bench.envs.solved.equilibrium import certified_equilibrium
from olne_bench.estimators.bilevel import Bilevel
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.protocol import Estimate
from olne_bench.estimators.ukf import Ukf
from olne_bench.games.model.equilibrium import Equilibrium
from olne_bench.games.model.observation import VIEWS
from olne_bench.games.solve.information import (
    deviations_of,
    joint_weight_covariance,
    observation_sensitivity,
    of_weights,
)

ESTIMATORS: dict[str, Any] = {"kkt_constrained": KktConstrained, "bilevel": Bilevel, "ukf": Ukf}
#: Scenario, options, and a low level of noise, of ``bounds``.
CASES: tuple[tuple[str, dict[str, Any], float], ...] = (
    ("unknown_goals", {}, 0.003),
    ("intersection", {"unknown_speeds": True}, 0.003),
    ("two_way", {"unknown_speeds": True}, 0.003),
)
SIGMA, CLOSE, EXACT = 0.005, 0.02, 1e-5  # of ``radius``
Truth = tuple[int, Scenario, Equilibrium]


def truths(name: str, seeds: int, **options: Any) -> list[Truth]:
    """The seed, scenario and motion of each draw that has an equilibrium."""
    found = []
    for seed in range(seeds):
        try:
            scenario = get_scenario(name, seed, **options)
            found.append((seed, scenario, certified_equilibrium(scenario)))
        except NoEquilibriumError:
            continue
    return found


def run(
    estimator: str, truth: Truth, view: str, sigma: float, *, known: bool = False
) -> tuple[float, Estimate]:
    """The seconds that an estimate took, and the estimate."""
    seed, scenario, motion = truth
    problem, seen = noisy(scenario, motion.states, sigma, view, rng=seed, known=known)
    method, rng = ESTIMATORS[estimator](), np.random.default_rng(seed)
    method.warm_up(problem)
    return shared.timed(method.estimate, problem, seen, rng=rng, budget=600.0)


def bounds(seeds: int = 40, estimator: Annotated[str, ESTIMATORS] = "kkt_constrained") -> None:
    """Estimates of weights and unknown parameters against their statistical bound, at low noise.

    A line per scenario and view: the error of the weights and of the parameters, each over its
    bound (Cramer-Rao, joint in weights, parameters and initial state), as a root mean square over
    seeds; the largest error of any weight and of any parameter from exact motion; and the median
    time over that of the same problem in which the parameters are known. Times are of the
    processor.
    """
    shared.show(
        bounds_row(name, view, estimator, truths(name, seeds, **options), sigma)
        for (name, options, sigma), view in product(CASES, ("full", "partial"))
    )


def bounds_row(
    name: str, view: str, estimator: str, drawn: list[Truth], sigma: float
) -> dict[str, object]:
    """One line of the table."""
    ratios, exact, times = [], [], []
    for truth in drawn:
        own_time, found = run(estimator, truth, view, sigma)
        _, clean = run(estimator, truth, view, 0.0)
        plain_time, _ = run(estimator, truth, view, sigma, known=True)
        scales = truth[1].told.parameters.deviations
        weights, parameters = errors_of(truth[1], found)
        squares = np.sum(weights**2), np.nansum((parameters / scales) ** 2)
        ratios.append((squares, bound_of(truth, view, sigma)))
        exact.append([np.nanmax(np.abs(errors)) for errors in errors_of(truth[1], clean)])
        times.append(own_time / plain_time)
    ratio = np.sqrt(np.mean([np.divide(*pair) for pair in ratios], axis=0))
    weight, parameter = (f"{largest:.1e}" for largest in np.max(exact, axis=0))
    return {
        "scenario": name,
        "view": view,
        "seeds": len(times),
        "weights/bound": f"{ratio[0]:.2f}",
        "parameters/bound": f"{ratio[1]:.2f}",
        "exact: weight": weight,
        "parameter": parameter,
        "time": f"{np.median(times):.2f}",
    }


def errors_of(scenario: Scenario, found: Estimate) -> tuple[np.ndarray, np.ndarray]:
    """Errors of weights (N, K), and of parameters (N, U) in their units (NaN: none)."""
    assert found.parameters is not None
    assert scenario.parameters is not None
    return found.weights - scenario.weights, found.parameters - scenario.parameters


def bound_of(truth: Truth, view: str, sigma: float) -> tuple[float, float]:
    """Traces of the bound of weights, and of parameters over their priors' deviations."""
    _, scenario, motion = truth
    game, scale = scenario.told, sensor_model(scenario, (VIEWS[view],)).noise_scale
    trajectory = motion.states, motion.controls, motion.costates
    sensitivity = observation_sensitivity(
        game, VIEWS[view], *trajectory, scenario.theta, noise_scale=scale
    )
    covariance = joint_weight_covariance(game, [sensitivity])
    if covariance is None:
        raise SystemExit(f"{scenario.name!r} is not identifiable in the view {view!r}")
    covariance = sigma**2 * covariance
    weights, deviations = of_weights(game, covariance), deviations_of(game, covariance)
    assert weights is not None
    assert deviations is not None
    scaled = (deviations / game.parameters.deviations) ** 2
    return float(np.trace(weights)), float(np.nansum(scaled))


def radius(
    seeds: int = 50,
    estimator: Annotated[str, ESTIMATORS] = "kkt_constrained",
    views: tuple[Annotated[str, VIEWS], ...] = ("full", "partial"),
) -> None:
    """The distance that vehicles of `merging` keep, estimated beside their weights.

    A line per view. Draws count where contact is active at the truth: the multiplier of some
    distance exceeds its margin. Of these, at sigma = 0.005: the median and the largest relative
    error of the distance, the share of draws within 2 %, and the root mean square of errors over
    what their deviations say. From exact motion: the largest error of the distance [m], and the
    number of draws whose weights are all within 1e-5. Last, the median time of the processor, and
    that of the same problem with a known distance.
    """
    drawn = truths("merging", seeds, weights="moderate", unknown_radius=True)
    touching = [truth for truth in drawn if truth[2].active.any()]
    shared.show(
        {"view": v, "draws": len(drawn)} | radius_row(v, estimator, touching) for v in views
    )


def radius_row(view: str, estimator: str, touching: list[Truth]) -> dict[str, object]:
    """Of the draws in which vehicles touch."""
    errors, scaled, exact, times = [], [], [], []
    for truth in touching:
        scenario = truth[1]
        own_time, found = run(estimator, truth, view, SIGMA)
        known_time, _ = run(estimator, truth, view, SIGMA, known=True)
        assert scenario.parameters is not None
        error = errors_of(scenario, found)[1][0, 0]
        errors.append(abs(error) / scenario.parameters[0, 0])
        deviations = found.parameter_deviations
        scaled.append(error / (np.nan if deviations is None else deviations[0, 0]))
        times.append((own_time, known_time))
        if estimator != "ukf":  # a filter needs noise
            weights, parameters = errors_of(scenario, run(estimator, truth, view, 0.0)[1])
            exact.append((abs(parameters[0, 0]), np.abs(weights).max() < EXACT))
    spent = np.median(times, axis=0)
    return {
        "contact": len(touching),
        "median": f"{np.median(errors):.2%}",
        "largest": f"{max(errors):.2%}",
        "within 2 %": f"{np.mean(np.array(errors) <= CLOSE):.0%}",
        "over deviation": f"{np.sqrt(np.mean(np.square(scaled))):.2f}",
        "exact: distance": f"{max((far for far, _ in exact), default=np.nan):.1e}",
        "weights": sum(good for _, good in exact),
        "time": f"{spent[0]:.2f}s",
        "known": f"{spent[1]:.2f}s",
    }


if __name__ == "__main__":
    shared.command(bounds, radius)
