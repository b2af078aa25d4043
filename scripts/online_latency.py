"""How long updates of a stream with a lag take, on one core.

    python scripts/online_latency.py [--lag 10] [--draws 20] [--methods map kkt_constrained]

Draws are seen one sample at a time through the view ``full``: three and five players of ``random``
at noise of 0.01, and five on the highway road at 0.1 m. A line for each game and method has the
median and the 95 % and 99 % percentiles [ms] of warm updates, which have a former solution and a
full window, and the same of all updates, the first ones included. Each has processor time, which
other programs on the machine disturb little, and wall-clock time, which is what a car has.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated

import shared
import numpy as np

from olne_bench.envs.recordings.recording import NoEquilibriumError, record
from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.map import Map
from olne_bench.estimators.protocol import Problem
from olne_bench.estimators.shared.incoming_samples import warm_up_stream
from olne_bench.games.model.observation import VIEWS

METHODS = {"map": Map(), "kkt_constrained": KktConstrained()}
#: Scenario, players and noise level.
GAMES = (("random", 3, 0.01), ("random", 5, 0.01), ("highway", 5, 0.1))
LEVELS = (50, 95, 99)
BUDGET = 60.0  # [s]


@dataclass(frozen=True)
class Updates:
    """The updates of some motions.

    Attributes:
        times: (U, 2) processor and wall-clock time [ms].
        warm: (U,) whether the window was full, and the update had a former solution.
        valid: (U,) whether there was an estimate.
    """

    times: np.ndarray
    warm: np.ndarray
    valid: np.ndarray


def main(
    lag: int = 10, draws: int = 20, methods: tuple[Annotated[str, METHODS], ...] = tuple(METHODS)
) -> None:
    """Measure and print."""
    names = " ".join(f"{level:>6}%" for level in LEVELS)
    print(f"lag {lag}; milliseconds, processor time / wall-clock time")
    print(f"game      players method           updates valid  warm: {names}   all: {names}")
    for scenario, players, sigma in GAMES:
        motions = list(observed(scenario, players, sigma, draws))
        for name in methods:
            found = updates_of(name, motions, lag)
            warm, everything = (
                percentiles(part) for part in (found.times[found.warm], found.times)
            )
            print(
                f"{scenario:9} {players:7} {name:16} {len(found.times):7} {found.valid.mean():5.1%}"
                f"  {warm}   {everything}",
                flush=True,
            )


def observed(
    scenario: str, players: int, sigma: float, draws: int
) -> Iterator[tuple[Problem, np.ndarray]]:
    """The problem and samples (T, N, d) of each draw that has an equilibrium."""
    for seed in range(draws):
        try:
            recording = record(get_scenario(scenario, seed, num_players=players))
        except NoEquilibriumError:
            continue
        scale = np.array(recording.scenario.noise_scale)
        noise = np.random.default_rng(seed).standard_normal(recording.states.shape)
        problem = Problem(
            recording.scenario.game, VIEWS["full"], sigma, noise_scale=tuple(map(float, scale))
        )
        yield problem, recording.states + sigma * scale * noise


def updates_of(name: str, motions: Sequence[tuple[Problem, np.ndarray]], lag: int) -> Updates:
    """Follow all motions with one method."""
    times, warm, valid = [], [], []
    for problem, y in motions:
        warm_up_stream(METHODS[name], problem, lag)
        stream = METHODS[name].start(problem, rng=np.random.default_rng(0), lag=lag)
        for count, sample in enumerate(y, start=1):
            own, wall = time.process_time(), time.perf_counter()
            estimate = stream.update(sample, budget=BUDGET)
            times.append(1e3 * np.array([time.process_time() - own, time.perf_counter() - wall]))
            warm.append(count > lag)
            valid.append(estimate.converged)
    return Updates(np.array(times), np.array(warm), np.array(valid))


def percentiles(times: np.ndarray) -> str:
    """Processor and wall-clock times (U, 2) in words."""
    found = np.percentile(times, LEVELS, axis=0)
    return " ".join(f"{own:.1f}/{wall:.1f}" for own, wall in found)


if __name__ == "__main__":
    shared.command(main)
