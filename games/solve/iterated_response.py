"""Iterated best response (IBR, Wang et al. 2019; the paper's ground truth).

Players respond to each other in turn until their plans no longer change. That leads into the basin
of an equilibrium where Newton's method from other starts ends at a saddle point of somebody's cost.

Responses are those of ``games.solve.best_response``: Newton's method in native code, where there is
any.
"""

import numpy as np

from olne_bench.games.compiled.native import NativeElimination, elimination
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.game import Game
from olne_bench.games.solve.best_response import best_response
from olne_bench.games.solve.newton import Root, rows, unpack

#: Plans have settled if no control changes by more than this in one round.
_SETTLED = 1e-3


def iterated_best_response(
    game: Game,
    weights: np.ndarray,
    initial_state: np.ndarray,
    controls: np.ndarray,
    *,
    max_rounds: int = 100,
    max_iterations: int = 1500,
    damping: float = 1.0,
    tolerance: float = _SETTLED,
    first: int = 0,
) -> Root:
    """Let the players respond in turn until their plans no longer change.

    Args:
        game: the game.
        weights: (N, K).
        initial_state: (N, n).
        controls: (T-1, N, m) first plans.
        max_rounds: rounds through all players.
        max_iterations: total iterations of the players' optimisers,
            after which no round starts.
        damping: share of the step towards its response that a player takes.
        tolerance: stop when no response differs by more from the player's plan in one round.
        first: the player that responds before the others.

    Returns:
        The last plans; the residual is infinity, as IBR does not evaluate G.
    """
    states = rollout(game.dynamics, initial_state, controls, game.dt)
    costates = np.zeros_like(states[1:])
    solver = elimination(game)
    if isinstance(solver, NativeElimination):
        z = solver.respond_in_turn(
            rows(game, states, controls, costates),
            np.ravel(weights),
            first=first,
            damping=damping,
            settled=tolerance,
            max_rounds=max_rounds,
            max_steps=max_iterations,
        )
        return Root(*unpack(game, z), residual=float("inf"))
    return _by_ipopt(
        game,
        weights,
        Root(states, controls.copy(), costates, residual=float("inf")),
        [(first + k) % game.num_players for k in range(game.num_players)],
        (max_rounds, max_iterations, damping, tolerance),
    )


def _by_ipopt(
    game: Game,
    weights: np.ndarray,
    plans: Root,
    order: list[int],
    limits: tuple[int, int, float, float],
) -> Root:
    """The same without native code; changes the plans in place."""
    max_rounds, max_iterations, damping, tolerance = limits
    states, controls, used = plans.states, plans.controls, 0
    for _ in range(max_rounds):
        largest = 0.0
        for i in order:
            response = best_response(game, i, states, controls, weights[i])
            used += response.iterations
            change = response.controls - controls[:, i]
            largest = max(largest, float(np.abs(change).max()))
            controls[:, i] += damping * change
            plans.costates[:, i] = response.costates
            states[:, i] = rollout(game.dynamics, states[0], controls, game.dt)[:, i]
        if largest < tolerance or used >= max_iterations:
            break
    return plans
