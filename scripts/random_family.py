"""Count how many draws of the random family have a certified equilibrium.

    python scripts/random_family.py --draws 100 --players 2 3 4

Prints one line per number of players, with the seeds without a certificate.
"""

import argparse
import time

from olne_bench.envs.scenarios import get_scenario
from olne_bench.games.olne import solve_olne


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=100, help="seeds 0, 1, ... per number")
    parser.add_argument("--players", type=int, nargs="+", default=[2, 3, 4])
    arguments = parser.parse_args()
    if arguments.draws < 1:
        parser.error(f"--draws must be at least 1, got {arguments.draws}")
    if min(arguments.players) < 1:
        parser.error(f"--players must be at least 1, got {arguments.players}")

    for num_players in arguments.players:
        started = time.monotonic()
        uncertified = uncertified_seeds(num_players, arguments.draws)
        certified = arguments.draws - len(uncertified)
        print(
            f"{num_players} players: {certified} of {arguments.draws} certified "
            f"in {time.monotonic() - started:.0f} s; without: {uncertified or 'none'}",
            flush=True,
        )


def uncertified_seeds(num_players: int, draws: int) -> list[int]:
    """Seeds below ``draws`` whose game has no certified equilibrium."""
    return [seed for seed in range(draws) if not _is_certified(num_players, seed)]


def _is_certified(num_players: int, seed: int) -> bool:
    scenario = get_scenario("random", seed, num_players=num_players)
    solution = solve_olne(scenario.game, scenario.weights, scenario.initial_state)
    return solution.certificate.passed


if __name__ == "__main__":
    main()
