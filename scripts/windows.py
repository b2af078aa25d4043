"""Estimates from the beginning of a motion, on HighwayEnv's roads.

    python scripts/windows.py [--samples 8] [--ahead 8] [--seeds 30 31 32] [--players 3 4]
                              [--methods map ...]

The first samples of each draw are seen through the view ``full``, the others are missing; the
game and its horizon are as ever. A table for each noise level has a line per road and method: how
many windows yield an estimate, the position error of its states some steps after the last sample
that was seen (median and largest over the windows, of means over players, for each number of
steps), and the median processor time. ``start`` is the game from which ``bilevel`` begins, and
filters that peek. Its error is that of its own states. ``uniform`` is the game at uniform weights
from x_1 of the pre-solve, and ``constant_velocity`` drives straight on from its last state.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Annotated

import shared
import numpy as np

from olne_bench.envs.recordings.recording import NoEquilibriumError, Recording, record
from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.bilevel import Bilevel
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.map import Map
from olne_bench.estimators.posterior import Posterior
from olne_bench.estimators.protocol import Estimator, Observation, Problem
from olne_bench.estimators.shared.belief import LostError, first_game
from olne_bench.estimators.shared.forward_model import warm_up_games
from olne_bench.estimators.shared.trajectory_fit import fit_trajectory
from olne_bench.estimators.ukf import Ukf
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.game import Game
from olne_bench.games.model.observation import VIEWS
from olne_bench.games.solve.olne import solve_olne

ROADS = ("highway", "merge", "two_way", "roundabout", "intersection")
SIGMAS = (0.1, 0.3)  # [m]
BUDGET = 60.0  # [s]


@dataclass(frozen=True)
class Window:
    """The first samples of a motion.

    Attributes:
        problem: what is known.
        y: (T, N, d) observations, NaN after the samples that are seen.
        states: (T, N, n) true motion.
        samples: number of samples that are seen.
    """

    problem: Problem
    y: np.ndarray
    states: np.ndarray
    samples: int

    @property
    def game(self) -> Game:
        """The game that is observed."""
        return self.problem.game


def recordings(road: str, draws: Iterator[tuple[int, int]]) -> Iterator[tuple[int, Recording]]:
    """The motion of each draw (seed, number of players) that can be played, with its seed."""
    for seed, players in draws:
        with suppress(NoEquilibriumError):
            yield seed, record(get_scenario(road, seed, num_players=players))


def some_windows(
    played: Sequence[tuple[int, Recording]], sigma: float, samples: int
) -> Iterator[Window]:
    """The first samples of recordings."""
    for seed, recording in played:
        scale = np.array(recording.scenario.noise_scale)
        noise = np.random.default_rng(seed).standard_normal(recording.states.shape)
        y = recording.states + sigma * scale * noise
        y[samples:] = np.nan
        game = recording.scenario.game
        problem = Problem(game, VIEWS["full"], sigma, noise_scale=tuple(map(float, scale)))
        yield Window(problem, y, recording.states, samples)


def print_line(
    road: str, sigma: float, name: str, windows: list[Window], ahead: Sequence[int]
) -> None:
    """Run one method on all windows."""
    errors, times = [], []
    for window in windows:
        warm_up_games(window.problem)
        began = time.process_time()
        states = METHODS[name](window)
        times.append(1e3 * (time.process_time() - began))
        if states is not None:
            last = window.game.horizon - 1
            at = [min(window.samples - 1 + step, last) for step in ahead]
            away = states[at, :, :2] - window.states[at, :, :2]
            errors.append(np.linalg.norm(away, axis=-1).mean(axis=1))
    found = np.array(errors or [np.full(len(ahead), np.nan)])
    columns = zip(np.median(found, axis=0), found.max(axis=0), strict=True)
    said = "".join(f"  {median:7.2f} m  {largest:7.2f} m" for median, largest in columns)
    print(
        f"{sigma:5g} {windows[0].samples:7} {road:12} {name:17} "
        f"{len(errors):3} of {len(windows):3}{said}  {np.median(times):8.1f} ms",
        flush=True,
    )


def by_estimator(made: Estimator, window: Window) -> np.ndarray | None:
    """The states of an estimate; None if it is not valid."""
    observation, rng = Observation(window.y), np.random.default_rng(0)
    found = made.estimate(window.problem, observation, rng=rng, budget=BUDGET)
    return found.states if found.converged else None


def by_start(window: Window) -> np.ndarray | None:
    """The states of the game from which filters begin."""
    try:
        return first_game(window.problem, Observation(window.y)).root.states
    except LostError:
        return None


def by_uniform_weights(window: Window) -> np.ndarray | None:
    """The certified motion at uniform weights from the fitted x_1."""
    start, game = fitted(window)[0], window.game
    weights = np.full((game.num_players, game.num_weights), 1 / game.num_weights)
    found = solve_olne(game, weights, start)
    return found.states if found.certificate.passed else None


def by_constant_velocity(window: Window) -> np.ndarray:
    """Straight on from the last state that the fit of the samples has, at its speed."""
    seen, game = fitted(window), window.game
    controls = np.zeros((game.horizon - window.samples, *game.control_shape[1:]))
    ahead = rollout(game.dynamics, seen[-1], controls, game.dt)
    return np.concatenate([seen[:-1], ahead])


def fitted(window: Window) -> np.ndarray:
    """(S, N, n) the most likely motion at the samples, without a game (eqn. pre_solve)."""
    y = window.y[: window.samples]
    problem = window.problem
    return fit_trajectory(problem.game, problem.view, y, problem.noise_scale).states


METHODS: dict[str, Callable[[Window], np.ndarray | None]] = {
    "kkt_constrained": partial(by_estimator, KktConstrained()),
    "map": partial(by_estimator, Map()),
    "posterior": partial(by_estimator, Posterior()),
    "bilevel": partial(by_estimator, Bilevel()),
    "ukf": partial(by_estimator, Ukf()),
    "start": by_start,
    "uniform": by_uniform_weights,
    "constant_velocity": by_constant_velocity,
}
USUAL = ("kkt_constrained", "map", "start", "uniform", "constant_velocity")


def main(
    samples: tuple[int, ...] = (8,),
    ahead: tuple[int, ...] = (8,),
    seeds: tuple[int, ...] = (30, 31, 32),
    players: tuple[int, ...] = (3, 4),
    roads: tuple[Annotated[str, ROADS], ...] = tuple(ROADS),
    sigmas: tuple[float, ...] = tuple(SIGMAS),
    methods: tuple[Annotated[str, METHODS], ...] = tuple(USUAL),
) -> None:
    """Measure and print."""
    steps = "".join(f"   ahead {step:2}:     largest" for step in ahead)
    print(f"noise samples road         method               started  {steps}         time")
    for road in roads:
        played = list(recordings(road, product(seeds, players)))
        for sigma, count in product(sigmas, samples):
            windows = list(some_windows(played, sigma, count))
            for name in methods:
                print_line(road, sigma, name, windows, ahead)


if __name__ == "__main__":
    shared.command(main)
