"""Numbers of players: one that is given, or one that each seed draws from a range."""

from collections.abc import Sequence

import numpy as np

from olne_bench.checks import as_text, check_whole, is_whole

#: The number of players is drawn from all that a scenario holds.
DRAWN = "drawn"

#: A number of players, ``DRAWN``, or the fewest and the most players to draw from.
PlayerNumber = int | str | Sequence[int]


def player_range(name: str, given: PlayerNumber, fewest: int, most: int) -> tuple[int, int]:
    """Fewest and most players of a scenario; ValueError on a number that it does not hold."""
    if given == DRAWN:
        return fewest, most
    if isinstance(given, Sequence):
        if isinstance(given, str) or len(given) != 2 or not all(map(is_whole, given)):
            raise ValueError(
                f"num_players must be a whole number, 'drawn' or [fewest, most], got {given!r}"
            )
        low, high = given
    else:
        check_whole("num_players", given)
        low = high = given
    for number in (low, high):
        if not fewest <= number <= most:
            raise ValueError(
                f"scenario {name!r} holds {fewest} to {most} players, got num_players = "
                f"{as_text(number)}"
            )
    if low > high:
        raise ValueError(f"num_players must be [fewest, most], got [{low}, {high}]")
    return int(low), int(high)


def player_number(bounds: tuple[int, int], seed: int) -> int:
    """The number of players of a seed, each number of the range with the same probability."""
    low, high = bounds
    return int(np.random.default_rng([seed, 0x4E]).integers(low, high + 1))
