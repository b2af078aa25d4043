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

from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from itertools import product
from typing import Annotated, NamedTuple

import shared
import numpy as np
from noisy import noisy

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
from olne_bench.games.solve.olne import solve_olne

ROADS = ("highway", "merge", "two_way", "roundabout", "intersection")
SIGMAS = (0.1, 0.3)  # [m]
BUDGET = 60.0  # [s]


class Window(NamedTuple):
    """The first samples of a motion; ``seen`` has NaN after them."""

    problem: Problem
    seen: Observation
    samples: int


def by_estimator(made: Estimator, window: Window) -> np.ndarray | None:
    """The states of an estimate; None if it is not valid."""
    rng = np.random.default_rng(0)
    found = made.estimate(window.problem, window.seen, rng=rng, budget=BUDGET)
    return found.states if found.converged else None


def by_start(window: Window) -> np.ndarray | None:
    """The states of the game from which filters begin."""
    with suppress(LostError):
        return first_game(window.problem, window.seen).root.states
    return None


def by_uniform_weights(window: Window) -> np.ndarray | None:
    """The certified motion at uniform weights from the fitted x_1."""
    game = window.problem.game
    weights = np.full((game.num_players, game.num_weights), 1 / game.num_weights)
    found = solve_olne(game, weights, fitted(window)[0])
    return found.states if found.certificate.passed else None


def by_constant_velocity(window: Window) -> np.ndarray:
    """Straight on from the last state that the fit of the samples has, at its speed."""
    seen, game = fitted(window), window.problem.game
    controls = np.zeros((game.horizon - window.samples, *game.control_shape[1:]))
    return np.concatenate([seen[:-1], rollout(game.dynamics, seen[-1], controls, game.dt)])


def fitted(window: Window) -> np.ndarray:
    """(S, N, n) the most likely motion at the samples, without a game (eqn. pre_solve)."""
    problem, y = window.problem, window.seen.y[: window.samples]
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

    def rows() -> Iterator[dict[str, object]]:
        for road in roads:
            played = recordings(road, product(seeds, players))
            for sigma, count, name in product(sigmas, samples, methods):
                place = {"noise": f"{sigma:g}", "samples": count, "road": road, "method": name}
                yield place | row(played, sigma, count, name, ahead)

    shared.show(rows())


def recordings(road: str, draws: Iterator[tuple[int, int]]) -> list[tuple[int, Recording]]:
    """The motion of each draw (seed, number of players) that can be played, with its seed."""
    found = []
    for seed, players in draws:
        with suppress(NoEquilibriumError):
            found.append((seed, record(get_scenario(road, seed, num_players=players))))
    return found


def row(
    played: list[tuple[int, Recording]],
    sigma: float,
    count: int,
    name: str,
    ahead: tuple[int, ...],
) -> dict[str, object]:
    """Run one method on the first samples of recordings."""
    errors, times = [], []
    for seed, recording in played:
        problem, seen = noisy(recording.scenario, recording.states, sigma, rng=seed)
        seen.y[count:] = np.nan
        warm_up_games(problem)
        seconds, states = shared.timed(METHODS[name], Window(problem, seen, count))
        times.append(seconds)
        if states is not None:
            last = problem.game.horizon - 1
            at = [min(count - 1 + step, last) for step in ahead]
            away = states[at, :, :2] - recording.states[at, :, :2]
            errors.append(np.linalg.norm(away, axis=-1).mean(axis=1))
    found = np.array(errors or [np.full(len(ahead), np.nan)])
    told: dict[str, object] = {"started": f"{len(errors)} of {len(played)}"}
    for step, own in zip(ahead, found.T, strict=True):
        told[f"ahead {step} [m]"] = f"{np.median(own):.2f}"
        told[f"largest {step}"] = f"{own.max():.2f}"
    return told | {"ms": f"{1e3 * np.median(times):.1f}"}


if __name__ == "__main__":
    shared.command(main)
