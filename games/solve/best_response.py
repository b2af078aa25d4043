"""One player's best open-loop response to the others' fixed trajectories (eqn. nash).

``best_responses`` is Newton's method in native code, where there is any, from several first plans;
``best_response`` is IPOPT, from the player's present trajectory, where there is no compiler.
"""

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from olne_bench.games.compiled.native import NativeElimination, Stop, elimination
from olne_bench.games.model.constraints import refuse_constraints
from olne_bench.games.model.costs import Stage
from olne_bench.games.model.dynamics import dynamics_errors, rollout
from olne_bench.games.model.game import Game, trajectory_symbols
from olne_bench.games.model.numbers import Structure, structure_and_numbers, with_symbols
from olne_bench.games.solve.ipopt import QUIET
from olne_bench.games.solve.newton import rows

#: Responses take 3 to 100 iterations, one in a thousand takes 900; longer ones are given up.
_MAX_ITERATIONS = 1000


@dataclass(frozen=True)
class Response:
    """A locally optimal response of one player.

    Attributes:
        states: (T, n), the player's own states.
        controls: (T-1, m).
        costates: (T-1, n), multipliers of the dynamics in the sign convention of
        ``games.solve.kkt``. cost: J^i at the response. converged: whether the optimiser reached a
        stationary point. iterations: number of the optimiser's iterations.
    """

    states: np.ndarray
    controls: np.ndarray
    costates: np.ndarray
    cost: float
    converged: bool
    iterations: int


@dataclass(frozen=True)
class Responses:
    """Locally optimal responses of one player from B first plans.

    Attributes:
        controls: (B, T-1, m).
        costates: (B, T-1, n), of the player's own state.
        costs: (B,) J^i. Infinity where IPOPT did not converge: its last point need not be a
            motion. Those of Newton's method are.
        converged: (B,) whether the optimiser reached a stationary point.
        iterations: (B,) that the optimiser took.
    """

    controls: np.ndarray
    costates: np.ndarray
    costs: np.ndarray
    converged: np.ndarray
    iterations: np.ndarray


def best_responses(
    game: Game,
    player: int,
    plans: np.ndarray,
    states: np.ndarray,
    controls: np.ndarray,
    weights: np.ndarray,
    *,
    tolerance: float = 1e-12,
    max_iterations: int = 200,
) -> Responses:
    """Minimise the player's cost over its own trajectory, from several first plans.

    Args:
        game: the game.
        player: index i.
        plans: (B, T-1, m) controls of this player to start from.
        states: (T, N, n); the others' parts are held, the first row is the initial state.
        controls: (T-1, N, m).
        weights: (N, K).
        tolerance: stop where Newton's step promises less than this share of 1 + |J^i|. IPOPT has a
            tolerance and a limit of its own.
        max_iterations: Newton steps for each plan at most.

    Raises:
        ValueError: on an array of the wrong shape, or if the game has constraints
            (``games.solve.constrained_response`` honours them).
    """
    refuse_constraints(game.constraints, "best_responses")
    solver = elimination(game)
    if isinstance(solver, NativeElimination):
        z = rows(game, states, controls, np.zeros_like(states[1:]))
        found = solver.responses(
            player,
            plans,
            z,
            np.ravel(weights),
            tolerance=tolerance,
            max_iterations=max_iterations,
        )
        stopped = found.stops != Stop.EARLY
        return Responses(found.controls, found.costates, found.costs, stopped, found.iterations)
    return _by_ipopt(game, player, plans, states, controls, weights)


def _by_ipopt(
    game: Game,
    player: int,
    plans: np.ndarray,
    states: np.ndarray,
    controls: np.ndarray,
    weights: np.ndarray,
) -> Responses:
    responses = []
    for plan in plans:
        joint, own = controls.copy(), states.copy()
        joint[:, player] = plan
        own[:, player] = rollout(game.dynamics, states[0], joint, game.dt)[:, player]
        responses.append(best_response(game, player, own, joint, np.asarray(weights)[player]))
    return Responses(
        controls=np.array([response.controls for response in responses]),
        costates=np.array([response.costates for response in responses]),
        costs=np.array([response.cost if response.converged else np.inf for response in responses]),
        converged=np.array([response.converged for response in responses]),
        iterations=np.array([response.iterations for response in responses]),
    )


def best_response(
    game: Game, player: int, states: np.ndarray, controls: np.ndarray, weights: np.ndarray
) -> Response:
    """Minimise the player's cost over its own trajectory, starting from its present one.

    Args:
        game: the game.
        player: index i.
        states: (T, N, n); the other players' parts are fixed. The player's own part is the
            starting point; its first row is the initial state.
        controls: (T-1, N, m); the player's own part is the starting point.
        weights: (K,) of this player.

    Raises:
        ValueError: if the game has constraints.
    """
    refuse_constraints(game.constraints, "best_response")
    structure, numbers = structure_and_numbers(game)
    solver = _response_solver(structure, game.horizon, player)
    own_states, own_controls = states[:, player], controls[:, player]
    solution = solver(
        x0=np.concatenate([own_states[1:].ravel(), own_controls.ravel()]),
        p=np.concatenate([states.ravel(), weights, numbers[player]]),
        lbg=0,
        ubg=0,
    )
    point = np.array(solution["x"]).ravel()
    split = own_states[1:].size
    return Response(
        states=np.vstack([own_states[:1], point[:split].reshape(own_states[1:].shape)]),
        controls=point[split:].reshape(own_controls.shape),
        costates=np.array(solution["lam_g"]).reshape(own_states[1:].shape),
        cost=float(solution["f"]),
        converged=bool(solver.stats()["success"]),
        iterations=int(solver.stats()["iter_count"]),
    )


@lru_cache(maxsize=64)
def _response_solver(structure: Structure, horizon: int, player: int) -> ca.Function:
    """The problem of one player in all games of a structure; the numbers are parameters."""
    dynamics, players = structure.dynamics, len(structure.players)
    n, m = dynamics.state_size, dynamics.control_size
    joint, joint_blocks = trajectory_symbols("x", (horizon, players, n))
    own_states, own_blocks = trajectory_symbols("x_own", (horizon - 1, 1, n))
    controls, control_blocks = trajectory_symbols("u_own", (horizon - 1, 1, m))
    model = structure.players[player]
    weights = ca.SX.sym("theta", len(model.preferences))
    numbers = ca.SX.sym("numbers", structure.num_numbers)
    dt, model = numbers[0], with_symbols(model, numbers[1:])

    own = [joint_blocks[0][player], *[row[0] for row in own_blocks]]
    own_controls = [row[0] for row in control_blocks]
    rows = [
        tuple(own[t] if j == player else block for j, block in enumerate(row))
        for t, row in enumerate(joint_blocks)
    ]
    stages = [
        Stage(player, row, control, dynamics, dt)
        for row, control in zip(rows, [*own_controls, None], strict=True)
    ]
    cost = sum(model.running_cost(stage, weights) for stage in stages[:-1])
    errors = dynamics_errors(dynamics, own, own_controls, dt)
    problem = {
        "x": ca.vertcat(own_states, controls),
        "p": ca.vertcat(joint, weights, numbers),
        "f": cost + model.final_cost(stages[-1], weights),
        "g": ca.vertcat(*errors),
    }
    options = QUIET | {"ipopt.tol": 1e-10, "ipopt.max_iter": _MAX_ITERATIONS}
    return ca.nlpsol("best_response", "ipopt", problem, options)
