"""One player's best open-loop response to the others' fixed trajectories (eqn. nash)."""

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from olne_bench.games.dynamics import dynamics_errors
from olne_bench.games.game import Game, player_cost, trajectory_symbols
from olne_bench.games.ipopt import QUIET

#: Responses take 3 to 100 iterations, one in a thousand takes 900; longer ones are given up.
_MAX_ITERATIONS = 1000


@dataclass(frozen=True)
class Response:
    """A locally optimal response of one player.

    Attributes:
        states: (T, n), the player's own states.
        controls: (T-1, m).
        costates: (T-1, n), multipliers of the dynamics in the sign convention of ``games.kkt``.
        cost: J^i at the response.
        converged: whether the optimiser reached a stationary point.
        iterations: number of the optimiser's iterations.
    """

    states: np.ndarray
    controls: np.ndarray
    costates: np.ndarray
    cost: float
    converged: bool
    iterations: int


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
    """
    solver = _response_solver(game, player)
    own_states, own_controls = states[:, player], controls[:, player]
    solution = solver(
        x0=np.concatenate([own_states[1:].ravel(), own_controls.ravel()]),
        p=np.concatenate([states.ravel(), weights]),
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


@lru_cache(maxsize=256)
def _response_solver(game: Game, player: int) -> ca.Function:
    n, m = game.dynamics.state_size, game.dynamics.control_size
    joint, joint_blocks = trajectory_symbols("x", game.state_shape)
    own_states, own_blocks = trajectory_symbols("x_own", (game.horizon - 1, 1, n))
    controls, control_blocks = trajectory_symbols("u_own", (game.horizon - 1, 1, m))
    weights = ca.SX.sym("theta", game.num_weights)

    own = [joint_blocks[0][player], *[row[0] for row in own_blocks]]
    own_controls = [row[0] for row in control_blocks]
    rows = [
        [own[t] if j == player else block for j, block in enumerate(row)]
        for t, row in enumerate(joint_blocks)
    ]
    errors = dynamics_errors(game.dynamics, own, own_controls, game.dt)
    problem = {
        "x": ca.vertcat(own_states, controls),
        "p": ca.vertcat(joint, weights),
        "f": player_cost(game, player, rows, own_controls, weights),
        "g": ca.vertcat(*errors),
    }
    options = QUIET | {"ipopt.tol": 1e-10, "ipopt.max_iter": _MAX_ITERATIONS}
    return ca.nlpsol("best_response", "ipopt", problem, options)
