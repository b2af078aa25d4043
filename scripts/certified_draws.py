"""How many draws of scenarios have a certified equilibrium, and what the far search is worth.

python scripts/certified_draws.py roads --draws 100 [--families merge two_way]
python scripts/certified_draws.py random --draws 100 --players 2 3 4
python scripts/certified_draws.py far [--draws 20] [--plans 200] [--scenarios roundabout ...]
"""

import time
from collections import Counter
from collections.abc import Iterator
from importlib import import_module
from typing import Annotated

import shared
import numpy as np
from scipy.interpolate import CubicSpline

from olne_bench.envs.roads.highway_roads import ROAD_NAMES
from olne_bench.envs.roads.road_scenario import rejection
from olne_bench.envs.scenarios import get_scenario, is_family, scenario_names
from olne_bench.games.model.game import Game
from olne_bench.games.solve.best_response import best_responses
from olne_bench.games.solve.far_search import MOST_STEPS, control_units, far_responses, first_plans
from olne_bench.games.solve.olne import CERTIFICATE_TOLERANCE, Equilibrium, certify, solve_olne

SIZES = {
    "highway": (3, 4, 5, 6, 7, 8),
    "intersection": (2, 3, 4),
    "merge": (2, 3, 4, 5, 6),
    "roundabout": (2, 3, 4),
    "two_way": (3, 4, 5),
}
RANDOM_STEPS = 200  # of a response to a random plan
KNOTS = 5  # of a random plan
PLAN_SIZES = (0.1, 2.0)  # of random plans, in units of ``control_units``


def roads(draws: int = 100, families: tuple[Annotated[str, ROAD_NAMES], ...] = ()) -> None:
    """Count the playable first draws of each HighwayEnv family, by reason.

    Certified means locally and globally so far. Numbers of players cycle through their range.
    """
    for name in families or ROAD_NAMES:
        family = import_module(f"olne_bench.envs.scenarios.{name}")
        reasons: Counter[str] = Counter()
        seconds = []
        for seed in range(draws):
            count = SIZES[name][seed % len(SIZES[name])]
            scenario = family.propose(np.random.default_rng([seed, count, 0]), count)
            spent, reason = shared.timed(rejection, scenario)
            reasons[reason or "playable"] += 1
            seconds.append(spent)
        print(
            f"{name}: {draws - reasons['no equilibrium']} of {draws} certified, "
            f"{reasons['playable']} playable, {reasons['collision']} predicted collisions, "
            f"{reasons['out of limits']} out of limits; "
            f"median {np.median(seconds):.1f} s, longest {max(seconds):.1f} s",
            flush=True,
        )


def random(draws: int = 100, players: tuple[int, ...] = (2, 3, 4)) -> None:
    """Count the draws of the random family that have a certified equilibrium.

    A line per number of players: draws with a locally certified equilibrium, those of them whose
    first one leaves a player a better response far away, and the seeds without an equilibrium that
    is certified globally so far.
    """
    for num_players in players:
        started = time.monotonic()
        local, better, without = 0, 0, []
        for seed in range(draws):
            scenario = get_scenario("random", seed, num_players=num_players)
            game, weights, start = scenario.game, scenario.weights, scenario.initial_state
            first = certify(game, solve_olne(game, weights, start), weights, search_far=True)
            local += first.local.passed
            better += first.local.passed and not first.passed
            if not first.passed:
                again = solve_olne(game, weights, start, search_far=True)
                without += [] if again.certificate.passed else [seed]
        print(
            f"{num_players} players: {local} of {draws} certified locally, {better} of "
            f"these with a better response far away, in {time.monotonic() - started:.0f} s; "
            f"without one certified globally so far: {without or 'none'}",
            flush=True,
        )


def far(draws: int = 20, plans: int = 200, scenarios: tuple[str, ...] = ()) -> None:
    """What the far search finds, beside many random first plans.

    Each draw's game is solved, as far as its local certificate asks. Then better responses of
    every player are looked for from the plans of ``games.solve.far_search`` and from random ones.
    A line per scenario: draws, players of all draws, how many of these have a better response by
    the search and by random plans, how many only the latter find, the draws with such players, and
    the median time of the search for one game. Then which share of the players with a better
    response each part finds alone. Hard constraints, which the search does not know, are left out.
    """
    parts: Counter[str] = Counter()
    every = {name: get_scenario(name) for name in scenarios or scenario_names()}
    names = [name for name, scenario in every.items() if not scenario.game.constraints]
    total = 0

    def rows() -> Iterator[dict[str, object]]:
        nonlocal total
        for name in names:
            row = far_row(name, draws, plans, parts)
            total += row["search"] + row["only random"]
            yield {"scenario": name, **row}

    shared.show(rows())
    print("first plans           alone find, of all players with a better response")
    for part, found in parts.most_common():
        print(f"{part:20} {found:4} of {total}")


def far_row(name: str, draws: int, count: int, parts: Counter[str]) -> dict[str, int]:
    """Of one scenario; counts what each part finds."""
    seeds = range(draws if is_family(name) else 1)
    found = np.zeros(3, dtype=int)  # by the search, by random plans, by these only
    games, players, times = 0, 0, []
    for seed in seeds:
        scenario = get_scenario(name, seed)
        game, weights = scenario.game, scenario.weights
        solved = solve_olne(game, weights, scenario.initial_state)
        motion = solved.states, solved.controls
        search = [shared.timed(far_responses, game, *motion, weights) for _ in range(3)]
        times.append(1e3 * min(seconds for seconds, _ in search))
        before = found[0] + found[2]
        for player in range(game.num_players):
            plans = first_plans(game, *motion, weights, player).items()
            better = {
                part
                for part, some in plans
                if gains(game, solved, weights, player, some, MOST_STEPS)
            }
            some = random_plans(game, solved, player, count)
            lucky = gains(game, solved, weights, player, some, RANDOM_STEPS)
            parts.update(better)
            found += bool(better), lucky, lucky and not better
        players += game.num_players
        games += int(found[0] + found[2] > before)
    counts = dict(zip(("search", "random", "only random"), map(int, found), strict=True))
    first = {"draws": len(seeds), "players": players}
    return first | counts | {"games": games, "ms": round(np.median(times))}


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
    least, most = PLAN_SIZES
    sizes = least * (most / least) ** rng.uniform(size=(count, 1, 1))
    return np.asarray(curves * sizes * control_units(game, solved.states, solved.controls, player))


if __name__ == "__main__":
    shared.command(roads, random, far)
