"""The true motion of a scenario, solved once."""

from functools import lru_cache

import numpy as np

from envs.scenarios.scenario import Scenario
from games.game import Game
from games.olne import Equilibrium, solve_olne


class NoEquilibriumError(Exception):
    """A scenario for which no certified equilibrium was found; it must not serve as truth."""


def equilibrium_of(scenario: Scenario) -> Equilibrium:
    """The certified equilibrium of a scenario.

    Raises:
        NoEquilibriumError: where none is certified.
    """
    weights, initial_state = scenario.weights, scenario.initial_state
    truth = _solve(scenario.game, weights.tobytes(), initial_state.tobytes())
    if not truth.certificate.passed:
        raise NoEquilibriumError(
            f"no certified equilibrium of {scenario.name!r}: residual {truth.residual:.1e}, "
            f"gains {truth.certificate.gains.tolist()}"
        )
    return truth


@lru_cache(maxsize=128)
def _solve(game: Game, weights: bytes, initial_state: bytes) -> Equilibrium:
    return solve_olne(
        game,
        np.frombuffer(weights).reshape(game.num_players, game.num_weights),
        np.frombuffer(initial_state).reshape(game.state_shape[1:]),
    )
