"""The true motion of a scenario: its certified equilibrium, solved once per process.

It is certified locally and globally so far (``games.solve.olne.Certificate``), or the draw is
refused. Equilibria may be kept on disk or come in a file (``envs.solved.kept_draws``).
"""

from functools import lru_cache

import numpy as np

from olne_bench.envs.scenarios.scenario import NoEquilibriumError, Scenario
from olne_bench.envs.solved import kept_draws
from olne_bench.games.model.game import Game
from olne_bench.games.solve.constrained import check_start, most_broken
from olne_bench.games.solve.olne import Equilibrium, solve_olne


def certified_equilibrium(scenario: Scenario) -> Equilibrium:
    """The scenario's OLNE, whose arrays are shared and read-only, or NoEquilibriumError."""
    try:
        check_start(scenario.game, scenario.initial_state)
    except ValueError as error:
        raise NoEquilibriumError(f"no equilibrium of {scenario.name!r}: {error}") from error
    if kept_draws.was_refused(scenario.game, scenario.weights, scenario.initial_state):
        raise NoEquilibriumError(
            f"no equilibrium of {scenario.name!r}: it was refused when the suite's draws were made"
        )
    # Arrays cannot be looked up in a cache, their bytes can.
    truth = _solve(scenario.game, scenario.weights.tobytes(), scenario.initial_state.tobytes())
    if not truth.certificate.passed:
        kept_draws.refuse(scenario.game, scenario.weights, scenario.initial_state)
        broken = most_broken(scenario.game, truth.margins)
        raise NoEquilibriumError(
            f"no certified equilibrium of {scenario.name!r}: residual {truth.residual:.1e}; "
            f"{truth.certificate}{'; ' + broken if broken else ''}"
        )
    return truth


@lru_cache(maxsize=128)
def _solve(game: Game, weights: bytes, initial_state: bytes) -> Equilibrium:
    theta = np.frombuffer(weights).reshape(game.num_players, game.num_weights)
    start = np.frombuffer(initial_state).reshape(game.state_shape[1:])
    truth = kept_draws.travelled(game, theta, start)
    if truth is None:
        name = kept_draws.name_of(game, theta, start)
        truth = None if name is None else kept_draws.read(name, game, theta, start)
        if truth is None:
            truth = solve_olne(game, theta, start, search_far=True)
            if name is not None:  # read again: the same bits as in later processes
                kept_draws.write(name, game, theta, truth)
                truth = kept_draws.read(name, game, theta, start) or truth
    for array in (truth.states, truth.controls, truth.costates, truth.certificate.costs):
        array.setflags(write=False)
    return truth
