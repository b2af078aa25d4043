"""What each player would do alone: plans that find their way round bends.

The horizon grows by a few steps at a time, so that a plan never has to find its way round a bend at
once.
"""

from dataclasses import replace

import numpy as np

from olne_bench.games.model.game import Game
from olne_bench.games.solve.iterated_response import iterated_best_response

#: Steps by which the horizon grows, and number that it begins with.
GROWTH, LEAST = 2, 3


def grown_plans(
    game: Game, start: np.ndarray, weights: np.ndarray, first: np.ndarray | None = None
) -> np.ndarray:
    """Plans (T-1, N, m) of players whose weights couple them to nobody.

    Args:
        game: the game, without constraints.
        start: (N, n) x_1.
        weights: (N, K), those of features that look at other players zero.
        first: (S, N, m) controls of the first steps to begin with; zeros if None.
    """
    if first is None:
        first = np.zeros((min(LEAST, game.horizon - 1), *game.control_shape[1:]))
    controls = first[: game.horizon - 1]
    while True:
        part = replace(game, horizon=len(controls) + 1)
        controls = iterated_best_response(part, weights, start, controls, max_rounds=1).controls
        missing = min(GROWTH, game.horizon - part.horizon)
        if missing == 0:
            return controls
        held = np.zeros((missing, *controls.shape[1:]))
        controls = np.concatenate([controls, held])
