"""What the far search finds, beside many random first plans.

    python scripts/far_search.py [--draws 20] [--random 200] [--scenarios roundabout random ...]

Each draw's game is solved, as far as its local certificate asks. Then better responses of every
player are looked for from the plans of ``games.solve.far_search`` and from random ones. A line per
scenario: draws, players of all draws, how many of these have a better response by the search and by
random plans, how many only the latter find, the draws with such players, and the median time of the
search for one game. Then which share of the players with a better response each part finds alone.
"""

import time
from collections import Counter

import shared
import numpy as np
from scipy.interpolate import CubicSpline

from olne_bench.envs.scenarios import get_scenario, is_family, scenario_names
from olne_bench.games.model.game import Game
from olne_bench.games.solve.best_response import best_responses
from olne_bench.games.solve.far_search import MOST_STEPS, control_units, far_responses, first_plans
from olne_bench.games.solve.olne import CERTIFICATE_TOLERANCE, Equilibrium, solve_olne

RANDOM_STEPS = 200  # of a response to a random plan
KNOTS = 5  # of a random plan
SIZES = (0.1, 2.0)  # of random plans, in units of ``control_units``


def main(draws: int = 20, random: int = 200, scenarios: tuple[str, ...] = ()) -> None:
    """Measure and print."""
    print("scenario            draws  players  search  random  only random  games   ms")
    parts: Counter[str] = Counter()
    total = 0
    for name in scenarios or unconstrained():
        total += print_scenario(name, draws, random, parts)
    print("first plans           alone find, of all players with a better response")
    for part, found in parts.most_common():
        print(f"{part:20} {found:4} of {total}")


def unconstrained() -> list[str]:
    """The scenarios whose games have no hard constraints: the far search knows none."""
    every = {name: get_scenario(name) for name in scenario_names()}
    return [name for name, scenario in every.items() if not scenario.game.constraints]


def print_scenario(name: str, draws: int, count: int, parts: Counter[str]) -> int:
    """The number of players with a better response; counts what each part finds."""
    seeds = range(draws if is_family(name) else 1)
    found, by_random, only_random, games, players, times = 0, 0, 0, 0, 0, []
    for seed in seeds:
        scenario = get_scenario(name, seed)
        game, weights = scenario.game, scenario.weights
        solved = solve_olne(game, weights, scenario.initial_state)
        times.append(min(milliseconds(game, solved, weights) for _ in range(3)))
        before = found + only_random
        for player in range(game.num_players):
            players += 1
            plans = first_plans(game, solved.states, solved.controls, weights, player)
            better = {
                part
                for part, some in plans.items()
                if gains(game, solved, weights, player, some, MOST_STEPS)
            }
            random = random_plans(game, solved, player, count)
            lucky = gains(game, solved, weights, player, random, RANDOM_STEPS)
            parts.update(better)
            found, by_random = found + bool(better), by_random + lucky
            only_random += lucky and not better
        games += found + only_random > before
    print(
        f"{name:20}{len(seeds):5}{players:9}{found:8}{by_random:8}{only_random:13}{games:7}"
        f"{np.median(times):5.0f}",
        flush=True,
    )
    return found + only_random


def milliseconds(game: Game, solved: Equilibrium, weights: np.ndarray) -> float:
    """Time of processor of one search."""
    started = time.process_time()
    far_responses(game, solved.states, solved.controls, weights)
    return 1e3 * (time.process_time() - started)


def gains(
    game: Game, solved: Equilibrium, weights: np.ndarray, player: int, plans: np.ndarray, steps: int
) -> bool:
    """Whether a response from one of the plans is better than the equilibrium."""
    if not len(plans):
        return False
    found = best_responses(
        game, player, plans, solved.states, solved.controls, weights, max_iterations=steps
    )
    cost = solved.certificate.costs[player]
    return bool(cost - np.nanmin(found.costs) > CERTIFICATE_TOLERANCE * (1 + abs(cost)))


def random_plans(game: Game, solved: Equilibrium, player: int, count: int) -> np.ndarray:
    """Smooth plans (count, T-1, m) of many sizes."""
    rng = np.random.default_rng(0)
    steps, size = game.horizon - 1, game.dynamics.control_size
    knots = rng.standard_normal((count, KNOTS, size))
    curves = CubicSpline(np.linspace(0, 1, KNOTS), knots, axis=1)(np.linspace(0, 1, steps))
    sizes = SIZES[0] * (SIZES[1] / SIZES[0]) ** rng.uniform(size=(count, 1, 1))
    units = control_units(game, solved.states, solved.controls, player)
    return np.asarray(curves * sizes * units)


if __name__ == "__main__":
    shared.command(main)
