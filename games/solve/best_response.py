"""Best open-loop responses to the others' fixed trajectories (eqn. nash), and these in turn.

Iterated best response (IBR, Wang et al. 2019; the paper's ground truth) leads into the basin of an
equilibrium where Newton's method from other starts ends at a saddle point of somebody's cost.
"""

from dataclasses import dataclass, replace

import numpy as np

from olne_bench.games.compiled.bindings import dense
from olne_bench.games.compiled.elimination import elimination
from olne_bench.games.model.constraints import refuse_constraints
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.game import Game
from olne_bench.games.solve.newton import Root, rows, unpack

#: Of each response: the share of 1 + |J^i| that a last step promises, and Newton steps.
_TOLERANCE, _MAX_ITERATIONS = 1e-12, 200

#: Plans have settled if no control changes by more than this in one round.
_SETTLED = 1e-3

#: Steps by which the horizon of ``grown_plans`` grows, and number that it begins with.
GROWTH, LEAST = 2, 3


@dataclass(frozen=True)
class Responses:
    """Locally optimal responses of one player from B first plans."""

    controls: np.ndarray  # (B, T-1, m)
    #: (B, T-1, n), of the player's own state, in the sign convention of ``games.solve.kkt``.
    costates: np.ndarray
    costs: np.ndarray  # (B,) J^i
    converged: np.ndarray  # (B,) whether the optimiser reached a stationary point
    iterations: np.ndarray  # (B,) Newton steps


def best_responses(
    game: Game,
    player: int,
    plans: np.ndarray,
    states: np.ndarray,
    controls: np.ndarray,
    weights: np.ndarray,
    *,
    tolerance: float = _TOLERANCE,
    max_iterations: int = _MAX_ITERATIONS,
) -> Responses:
    """Minimise the player's cost over its own trajectory, from several first plans.

    Plans are (B, T-1, m); the others' parts of states (T, N, n), whose first row is the initial
    state, and controls (T-1, N, m) are held; weights are (N, K). Newton's method stops where its
    step promises less than ``tolerance`` of 1 + |J^i|. Raises ValueError on a wrong shape, or if
    the game has constraints (``games.solve.constrained_response`` honours them).
    """
    refuse_constraints(game.constraints, "best_responses")
    solver, count = elimination(game), len(plans)
    z = rows(game, states, controls, np.zeros_like(states[1:]))
    plans = dense("plans", plans, (count, *controls[:, player].shape)).copy()
    costates, costs = np.zeros((count, *states[1:, player].shape)), np.empty(count)
    stops, iterations = np.empty((2, count), dtype=np.int32)
    solver.library.responses(
        *(solver.work, player, count, *solver.point(z, np.ravel(weights))),
        *(tolerance, max_iterations, plans, costates, costs, stops, iterations),
        np.empty(solver.library.response_space(game.horizon)),
    )
    return Responses(plans, costates, costs, stops != 0, iterations)


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
        max_iterations: total iterations of the players' optimisers, after which no round starts.
        damping: share of the step towards its response that a player takes.
        tolerance: stop when no response differs by more from the player's plan in one round.
        first: the player that responds before the others.

    Returns the last plans; the residual is infinity, as IBR does not evaluate G.
    """
    states = rollout(game.dynamics, initial_state, controls, game.dt)
    solver = elimination(game)
    z, theta = solver.point(
        rows(game, states, controls, np.zeros_like(states[1:])), np.ravel(weights)
    )
    solver.library.respond_in_turn(
        *(solver.work, first, z, theta, damping, tolerance, _TOLERANCE, _MAX_ITERATIONS),
        *(max_rounds, max_iterations, np.empty(solver.library.response_space(game.horizon))),
    )
    return Root(*unpack(game, z), residual=float("inf"))


def grown_plans(
    game: Game, start: np.ndarray, weights: np.ndarray, first: np.ndarray | None = None
) -> np.ndarray:
    """Plans (T-1, N, m) of players whose weights (N, K) couple them to nobody; no constraints.

    The horizon grows from x_1 (N, n) by a few steps at a time, so that a plan never has to find its
    way round a bend at once. It begins with the controls (S, N, m) of the first steps; zeros if
    None.
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
