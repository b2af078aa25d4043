"""Games of many players: set-up, equilibria from nothing, and estimates.

    python scripts/many_players.py --players 10 20 --draws 20

Prints one line per number of players: seconds of processor time to write and compile the solvers
in an empty cache, draws of ``random`` whose equilibrium is certified locally, and medians of the
time for it, of its certificate, and of an estimate by ``kkt_constrained`` from noisy samples.
"""

import os
import resource
import tempfile

import shared
import numpy as np

from olne_bench.bench.judge.metrics.formulas import cosine_error
from olne_bench.envs.scenarios import Scenario, get_scenario
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.games.model.observation import VIEWS
from olne_bench.games.solve.olne import certify, solve_olne

SIGMA = 0.01


def main(
    players: tuple[int, ...] = (10, 20),
    draws: int = 20,
    estimates: int = 5,
) -> None:
    """Command line."""
    for num_players in players:
        with tempfile.TemporaryDirectory() as cache:
            os.environ["OLNE_BENCH_CACHE"] = cache
            print(line(num_players, draws, estimates), flush=True)


def line(num_players: int, draws: int, estimates: int) -> str:
    """What was measured for a number of players."""
    set_up = -used()
    KktConstrained().warm_up(problem_of(get_scenario("random", 0, num_players=num_players)))
    set_up += used()
    certified = 0
    solves: list[float] = []
    certificates: list[float] = []
    inverse: list[float] = []
    errors: list[float] = []
    for seed in range(draws):
        scenario = get_scenario("random", seed, num_players=num_players)
        solve, check, found = forward(scenario)
        solves.append(solve)
        certificates.append(check)
        certified += found is not None
        if found is not None and len(inverse) < estimates:
            seconds, error = estimated(scenario, found, seed)
            inverse.append(seconds)
            errors.append(error)
    return (
        f"{num_players} players: set-up {set_up:.1f} s, {certified} of {draws} certified, "
        f"from nothing {np.median(solves):.2f} s (largest {max(solves):.2f}), "
        f"certificate {np.median(certificates):.2f} s, "
        f"estimate {np.median(inverse):.2f} s, cosine error {np.median(errors):.4f}"
    )


def forward(scenario: Scenario) -> tuple[float, float, np.ndarray | None]:
    """Seconds of a solve and of its certificate, and its states if it is certified locally."""
    game, weights = scenario.game, scenario.weights
    solve, found = shared.timed(lambda: solve_olne(game, weights, scenario.initial_state))
    check, certificate = shared.timed(lambda: certify(game, found, weights))
    return solve, check, found.states if certificate.local.passed else None


def estimated(scenario: Scenario, states: np.ndarray, seed: int) -> tuple[float, float]:
    """Seconds of an estimate from noisy samples, and its mean cosine error."""
    rng = np.random.default_rng(seed)
    seen = Observation(states + SIGMA * rng.standard_normal(states.shape))
    problem = problem_of(scenario)
    seconds, estimate = shared.timed(
        lambda: KktConstrained().estimate(problem, seen, rng=rng, budget=600)
    )
    return seconds, cosine_error(estimate.weights, scenario.weights)


def problem_of(scenario: Scenario) -> Problem:
    """The problem with full observations."""
    return Problem(scenario.game, VIEWS["full"], sigma=SIGMA)


def used() -> float:
    """Seconds of processor time of this process and its children."""
    both = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(one.ru_utime + one.ru_stime for one in both)


if __name__ == "__main__":
    shared.command(main)
