"""How long estimates and equilibria take, on one core.

    python scripts/speed.py roads [--draws 10] [--trials 2] [--estimators kkt_constrained ukf ...]
    python scripts/speed.py many --players 10 20 --draws 20
    python scripts/speed.py updates [--lag 10] [--draws 20] [--methods map kkt_constrained]

``scripts/perf.py`` measures the solvers against others.
"""

import os
import resource
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import partial
from itertools import product
from typing import Annotated, Any

import shared
import numpy as np
from noisy import noisy

from olne_bench.bench.judge.metrics.formulas import cosine_error
from olne_bench.envs.recordings.recording import NoEquilibriumError, record
from olne_bench.envs.scenarios import (
    get_scenario,
    highway,
    intersection,
    merge,
    roundabout,
    two_way,
)
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.map import Map
from olne_bench.estimators.particle import Particle
from olne_bench.estimators.posterior import Posterior
from olne_bench.estimators.protocol import Problem
from olne_bench.estimators.shared.incoming_samples import warm_up_stream
from olne_bench.estimators.ukf import Ukf
from olne_bench.games.model.observation import VIEWS
from olne_bench.games.solve.olne import certify, solve_olne

ROADS = {
    "highway": (highway.propose, 5),
    "merge": (merge.propose, 5),
    "two_way": (two_way.propose, 5),
    "roundabout": (roundabout.propose, 4),
    "intersection": (intersection.propose, 4),
}
ESTIMATORS: dict[str, Any] = {
    "kkt_constrained": KktConstrained,
    "ukf": Ukf,
    "particle": Particle,
    "posterior": Posterior,
}
SIGMAS = (0.1, 0.5)
#: Of ``updates``: methods; scenarios, players and noise levels; and percentiles.
METHODS = {"map": Map(), "kkt_constrained": KktConstrained()}
GAMES = (("random", 3, 0.01), ("random", 5, 0.01), ("highway", 5, 0.1))
LEVELS = (50, 95, 99)


def roads(
    draws: int = 10,
    trials: int = 2,
    estimators: tuple[Annotated[str, ESTIMATORS], ...] = tuple(ESTIMATORS),
) -> None:
    """Processor time on HighwayEnv's roads: one more draw, and trials of estimators.

    First a line per road on draws: number of players, median and largest time until the game is
    ready, solved and certified locally, and how many are. Each road's first draw, which compiles
    its solver, is not counted. Then a line per road and estimator: median and largest time of a
    trial, over draws, two levels of noise and both views, how many converged, and the median cosine
    error. Building solvers (``warm_up``) is not counted, as in a run.
    """
    shared.show(draws_row(name, draws) for name in ROADS)
    shared.show(trials_row(name, one, trials) for name, one in product(ROADS, estimators))


def milliseconds(times: Sequence[float]) -> dict[str, object]:
    """Median and largest of times [s]."""
    return {
        "median ms": f"{1e3 * np.median(times):.1f}",
        "largest ms": f"{1e3 * max(times):.1f}",
    }


def draws_row(name: str, draws: int) -> dict[str, object]:
    """Time the draws after the first."""
    propose, players = ROADS[name]
    times, certified = [], 0
    for seed in range(draws + 1):
        scenario = propose(np.random.default_rng([seed, players, 0]), players)
        given = scenario.game, scenario.weights, scenario.initial_state
        seconds, found = shared.timed(solve_olne, *given)
        times.append(seconds)
        certified += bool(seed and found.certificate.passed)
    told = {"road": name, "N": players} | milliseconds(times[1:])
    return told | {"certified": f"{certified} of {draws}"}


def trials_row(name: str, estimator: str, draws: int) -> dict[str, object]:
    """Time the trials of one estimator on one road."""
    times, converged, errors = [], 0, []
    for seed, sigma, view in product(range(draws), SIGMAS, VIEWS):
        scenario = get_scenario(name, seed)
        truth = solve_olne(scenario.game, scenario.weights, scenario.initial_state)
        problem, seen = noisy(scenario, truth.states, sigma, view, rng=seed)
        method, rng = ESTIMATORS[estimator](), np.random.default_rng(seed)
        method.warm_up(problem)
        seconds, estimate = shared.timed(method.estimate, problem, seen, rng=rng, budget=120.0)
        times.append(seconds)
        converged += estimate.converged
        errors.append(cosine_error(estimate.weights, scenario.weights))
    told = {"road": name, "estimator": estimator, "N": scenario.game.num_players}
    ends = {"converged": f"{converged} of {len(times)}", "cosine error": float(np.median(errors))}
    return told | milliseconds(times) | ends


def many(players: tuple[int, ...] = (10, 20), draws: int = 20, estimates: int = 5) -> None:
    """Games of many players: set-up, equilibria from nothing, and estimates.

    A line per number of players: seconds of processor time to write and compile the solvers in an
    empty cache, draws of ``random`` whose equilibrium is certified locally, and medians of the time
    for it, of its certificate, and of an estimate by ``kkt_constrained`` from noisy samples.
    """
    for count in players:
        with tempfile.TemporaryDirectory() as cache:
            os.environ["OLNE_BENCH_CACHE"] = cache
            print(many_line(count, draws, estimates), flush=True)


def many_line(count: int, draws: int, estimates: int) -> str:
    """What was measured for a number of players."""
    drawn = partial(get_scenario, "random", num_players=count)
    set_up, method = -used(), KktConstrained()
    method.warm_up(Problem(drawn(0).game, VIEWS["full"], sigma=0.01))
    set_up += used()
    solves, checks, certified = [], [], 0
    inverse: list[float] = []
    errors: list[float] = []
    for seed in range(draws):
        scenario = drawn(seed)
        game, weights = scenario.game, scenario.weights
        seconds, found = shared.timed(solve_olne, game, weights, scenario.initial_state)
        check, certificate = shared.timed(certify, game, found, weights)
        solves.append(seconds)
        checks.append(check)
        certified += certificate.local.passed
        if certificate.local.passed and len(inverse) < estimates:
            rng = np.random.default_rng(seed)
            given = noisy(scenario, found.states, 0.01, rng=rng)
            seconds, estimate = shared.timed(method.estimate, *given, rng=rng, budget=600)
            inverse.append(seconds)
            errors.append(cosine_error(estimate.weights, weights))
    return (
        f"{count} players: set-up {set_up:.1f} s, {certified} of {draws} certified, "
        f"from nothing {np.median(solves):.2f} s (largest {max(solves):.2f}), "
        f"certificate {np.median(checks):.2f} s, "
        f"estimate {np.median(inverse):.2f} s, cosine error {np.median(errors):.4f}"
    )


def used() -> float:
    """Seconds of processor time of this process and its children."""
    both = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(one.ru_utime + one.ru_stime for one in both)


def updates(
    lag: int = 10, draws: int = 20, methods: tuple[Annotated[str, METHODS], ...] = tuple(METHODS)
) -> None:
    """How long updates of a stream with a lag take.

    Draws are seen one sample at a time through the view ``full``: three and five players of
    ``random`` at noise of 0.01, and five on the highway road at 0.1 m. A line for each game and
    method has the median and the 95 % and 99 % percentiles [ms] of warm updates, which have a
    former solution and a full window, and the same of all updates, the first ones included. Each
    has processor time, which other programs on the machine disturb little, and wall-clock time,
    which is what a car has.
    """
    print(f"lag {lag}; milliseconds, processor time / wall-clock time")
    shared.show(
        {"game": game[0], "players": game[1], "method": name} | updates_row(game, name, lag, draws)
        for game, name in product(GAMES, methods)
    )


def updates_row(game: tuple[str, int, float], name: str, lag: int, draws: int) -> dict[str, object]:
    """Follow all motions with one method."""
    method, times, warm, valid = METHODS[name], [], [], []
    for problem, y in observed(*game, draws):
        warm_up_stream(method, problem, lag)
        stream = method.start(problem, rng=np.random.default_rng(0), lag=lag)
        for count, sample in enumerate(y, start=1):
            began = np.array(shared.clock())
            estimate = stream.update(sample, budget=60.0)
            times.append(1e3 * (np.array(shared.clock()) - began))
            warm.append(count > lag)
            valid.append(estimate.converged)
    row: dict[str, object] = {"updates": len(times), "valid": f"{np.mean(valid):.1%}"}
    for head, part in (("warm", np.array(times)[warm]), ("all", np.array(times))):
        for level, (own, wall) in zip(LEVELS, np.percentile(part, LEVELS, axis=0), strict=True):
            row[f"{head} {level}%"] = f"{own:.1f}/{wall:.1f}"
    return row


def observed(
    scenario: str, players: int, sigma: float, draws: int
) -> Iterator[tuple[Problem, np.ndarray]]:
    """The problem and samples (T, N, d) of each draw that has an equilibrium."""
    for seed in range(draws):
        with suppress(NoEquilibriumError):
            recording = record(get_scenario(scenario, seed, num_players=players))
            problem, seen = noisy(recording.scenario, recording.states, sigma, rng=seed)
            yield problem, seen.y


if __name__ == "__main__":
    shared.command(roads, many, updates)
