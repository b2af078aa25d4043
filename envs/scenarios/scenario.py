"""What a scenario is."""

from dataclasses import dataclass

import numpy as np

from games.game import Game


@dataclass(frozen=True)
class Scenario:
    """A game with its ground truth.

    ``solve_olne(scenario.game, scenario.weights, scenario.initial_state)`` is the true motion.

    Attributes:
        name: name under which ``get_scenario`` knows it.
        game: the game without its truth.
        weights: (N, K) true weights, rows sum to one.
        initial_state: (N, n) true x_1.
    """

    name: str
    game: Game
    weights: np.ndarray
    initial_state: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "weights", self.game.check_weights(self.weights))
        state = self.game.check_initial_state(self.initial_state)
        object.__setattr__(self, "initial_state", state)
