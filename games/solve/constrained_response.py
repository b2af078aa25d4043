"""One player's best response to the others' motion under its constraints, by IPOPT.

It shares no code with the solver of the game, so that certificates and tests are independent of it.
"""

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from olne_bench.games.model.constraints import Constraint
from olne_bench.games.model.costs import Stage
from olne_bench.games.model.dynamics import Dynamics, dynamics_errors, rollout
from olne_bench.games.model.game import Game, trajectory_symbols
from olne_bench.games.model.numbers import (
    Structure,
    numbers_of,
    numbers_table,
    structure_and_numbers,
    with_symbols,
)
from olne_bench.games.solve.ipopt import QUIET

#: IPOPT starts at the equilibrium, where multipliers are small but for active constraints.
_OPTIONS = QUIET | {
    "ipopt.tol": 1e-10,
    "ipopt.max_iter": 500,
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.mu_init": 1e-6,
    "ipopt.bound_push": 1e-8,
}


@dataclass(frozen=True)
class ConstrainedResponse:
    """A locally optimal response of one player that keeps its constraints."""

    states: np.ndarray  # (T, n), the player's own states
    controls: np.ndarray  # (T-1, m)
    cost: float  # J^i at the response
    converged: bool  # whether the optimiser reached a stationary point


def constrained_response(
    game: Game,
    player: int,
    states: np.ndarray,
    controls: np.ndarray,
    plan: np.ndarray,
    weights: np.ndarray,
) -> ConstrainedResponse:
    """Minimise the player's cost over its own motion, from a plan (T-1, m), under its constraints.

    The other players' parts of states (T, N, n) and controls (T-1, N, m) are held; weights (K,) are
    those of this player.
    """
    structure, numbers = structure_and_numbers(game)
    solver, equations = _solver(structure, game.horizon, player)
    joint = controls.copy()
    joint[:, player] = plan
    own = rollout(game.dynamics, states[0], joint, game.dt)[1:, player]
    solution = solver(
        x0=np.concatenate([own.ravel(), plan.ravel()]),
        p=np.concatenate(
            [
                *(states.ravel(), controls.ravel(), weights, numbers[player]),
                numbers_table(game.constraints, game.dt).ravel(),
            ]
        ),
        lbg=0,
        ubg=np.concatenate([np.zeros(equations), np.full(solver.numel_in(4) - equations, np.inf)]),
    )
    point = np.array(solution["x"]).ravel()
    return ConstrainedResponse(
        states=np.vstack([states[:1, player], point[: own.size].reshape(own.shape)]),
        controls=point[own.size :].reshape(plan.shape),
        cost=float(solution["f"]),
        converged=bool(solver.stats()["success"]),
    )


@lru_cache(maxsize=64)
def _solver(structure: Structure, horizon: int, player: int) -> tuple[ca.Function, int]:
    """The problem of one player in all games of a structure, and its number of equations."""
    dynamics, players = structure.dynamics, len(structure.players)
    n, m = dynamics.state_size, dynamics.control_size
    joint, state_blocks = trajectory_symbols("x", (horizon, players, n))
    joint_controls, control_blocks = trajectory_symbols("u", (horizon - 1, players, m))
    own_states, own_blocks = trajectory_symbols("x_own", (horizon - 1, 1, n))
    own_controls, own_control_blocks = trajectory_symbols("u_own", (horizon - 1, 1, m))
    model = structure.players[player]
    weights = ca.SX.sym("theta", len(model.preferences))
    numbers = ca.SX.sym("numbers", structure.num_numbers)
    dt, model = numbers[0], with_symbols(model, numbers[1:])

    own = [state_blocks[0][player], *[row[0] for row in own_blocks]]
    for row, state in zip(state_blocks, own, strict=True):
        row[player] = state
    for row, control in zip(control_blocks, own_control_blocks, strict=True):
        row[player] = control[0]
    rows = [*zip(state_blocks, [*control_blocks, None], strict=True)]
    stages = [
        Stage(player, tuple(row), None if u is None else u[player], dynamics, dt) for row, u in rows
    ]
    cost = sum(model.running_cost(stage, weights) for stage in stages[:-1])
    errors = dynamics_errors(dynamics, own, [row[0] for row in own_control_blocks], dt)

    width = 1 + max((len(numbers_of(one)) for one in structure.constraints), default=0)
    table = ca.SX.sym("constraint_numbers", width, len(structure.constraints))
    margins = []
    for index, constraint in enumerate(structure.constraints):
        if player in constraint.players:
            written = with_symbols(constraint, table[1:, index])
            margins += _margins(written, rows, dynamics, dt, own_states, own_controls)
    problem = {
        "x": ca.vertcat(own_states, own_controls),
        "p": ca.vertcat(joint, joint_controls, weights, numbers, ca.vec(table)),
        "f": cost + model.final_cost(stages[-1], weights),
        "g": ca.vertcat(*errors, *margins),
    }
    equations = sum(error.numel() for error in errors)
    return ca.nlpsol("constrained_response", "ipopt", problem, _OPTIONS), equations


def _margins(
    constraint: Constraint,
    rows: list[tuple[list[ca.SX], list[ca.SX] | None]],
    dynamics: Dynamics,
    dt: ca.SX,
    *unknowns: ca.SX,
) -> list[ca.SX]:
    """The margins of a constraint, step by step, that depend on the unknowns."""
    found = []
    for states, controls in rows[constraint.first_step :]:
        own = None if controls is None else controls[constraint.players[0]]
        seen = tuple(states[j] for j in constraint.players)
        margins = ca.SX(constraint.margins(Stage(0, seen, own, dynamics, dt)))
        found += [
            part for part in ca.vertsplit(margins) if ca.depends_on(part, ca.vertcat(*unknowns))
        ]
    return found
