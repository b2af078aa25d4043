"""Count how many draws of the random family have a certified equilibrium.

    python scripts/random_family.py --draws 100 --players 2 3 4

Prints one line per number of players: draws with a locally certified equilibrium, those of
them whose first one leaves a player a better response far away, and the seeds without an
equilibrium that is certified globally so far.
"""

import time

import shared

from olne_bench.envs.scenarios import get_scenario
from olne_bench.games.solve.olne import Certificate, certify, solve_olne


def main(
    draws: int = 100,
    players: tuple[int, ...] = (2, 3, 4),
) -> None:
    """Command line."""
    if draws < 1:
        raise SystemExit(f"--draws must be at least 1, got {draws}")
    if min(players) < 1:
        raise SystemExit(f"--players must be at least 1, got {players}")

    for num_players in players:
        started = time.monotonic()
        local, better, without = 0, 0, []
        for seed in range(draws):
            first, passed = certificates(num_players, seed)
            local += first.local.passed
            better += first.local.passed and not first.passed
            without += [] if passed else [seed]
        print(
            f"{num_players} players: {local} of {draws} certified locally, {better} of "
            f"these with a better response far away, in {time.monotonic() - started:.0f} s; "
            f"without one certified globally so far: {without or 'none'}",
            flush=True,
        )


def certificates(num_players: int, seed: int) -> tuple[Certificate, bool]:
    """The certificate of a draw's first equilibrium, and whether any passes both searches."""
    scenario = get_scenario("random", seed, num_players=num_players)
    game, weights = scenario.game, scenario.weights
    found = solve_olne(game, weights, scenario.initial_state)
    first = certify(game, found, weights, search_far=True)
    if first.passed:
        return first, True
    again = solve_olne(game, weights, scenario.initial_state, search_far=True)
    return first, again.certificate.passed


if __name__ == "__main__":
    shared.command(main)
