"""The true motion of a scenario: its certified equilibrium, solved once per process.

Equilibria of draws that a user plays in a world are kept on disk (``envs.kept_draws``).
"""

from functools import lru_cache

import numpy as np

from olne_bench.envs import kept_draws
from olne_bench.envs.scenarios.scenario import NoEquilibriumError, Scenario
from olne_bench.games.game import Game
from olne_bench.games.olne import Equilibrium, solve_olne


def certified_equilibrium(scenario: Scenario) -> Equilibrium:
    """The scenario's OLNE. Its arrays are shared and read-only.

    Raises:
        NoEquilibriumError: if the equilibrium is not certified.
    """
    # Arrays cannot be looked up in a cache, their bytes can.
    truth = _solve(scenario.game, scenario.weights.tobytes(), scenario.initial_state.tobytes())
    if not truth.certificate.passed:
        raise NoEquilibriumError(
            f"no certified equilibrium of {scenario.name!r}: residual {truth.residual:.1e}, "
            f"gains {truth.certificate.gains.tolist()}"
        )
    return truth


@lru_cache(maxsize=128)
def _solve(game: Game, weights: bytes, initial_state: bytes) -> Equilibrium:
    kept = kept_draws.file_of(game, weights, initial_state)
    truth = None if kept is None else kept_draws.read(kept)
    if truth is None:
        truth = solve_olne(
            game,
            np.frombuffer(weights).reshape(game.num_players, game.num_weights),
            np.frombuffer(initial_state).reshape(game.state_shape[1:]),
        )
        if kept is not None:
            kept_draws.write(kept, truth)
    certificate = truth.certificate
    for array in (truth.states, truth.controls, truth.costates, certificate.costs):
        array.setflags(write=False)
    return truth
