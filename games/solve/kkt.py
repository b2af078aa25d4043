"""The stacked first-order conditions of an open-loop Nash equilibrium.

Peters et al. 2021, eqn. forward_kkt_conditions:

    G(x, u, lambda; theta) = [ grad_{x^i} J^i + lambda^i' grad_{x^i} F   (all i, t = 2..T)
                               grad_{u^i} J^i + lambda^i' grad_{u^i} F   (all i, t = 1..T-1)
                               F(x, u)                                   (all i, t = 1..T-1) ]

with F_t = x_{t+1} - f(x_t, u_t). The players' dynamics are decoupled, so player i needs only the
costates of its own state: the paper's costates of the other players' states appear in no other row
and drop out. CasADi computes all derivatives.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from olne_bench.games.compiled.elimination import elimination
from olne_bench.games.model.constraints import refuse_constraints
from olne_bench.games.model.dynamics import dynamics_errors
from olne_bench.games.model.game import Game, player_cost, trajectory_symbols
from olne_bench.games.solve.newton import pack


@dataclass(frozen=True)
class KktSystem:
    """Symbols and expressions of one game's first-order conditions, flat in the arrays' C order."""

    game: Game  # the game
    states: ca.SX  # symbol of x (T, N, n), the initial state included
    controls: ca.SX  # symbol of u (T-1, N, m)
    costates: ca.SX  # symbol of lambda (T-1, N, n); entry t belongs to the step from t to t+1
    weights: ca.SX  # symbol of theta (N, K)
    costs: ca.SX  # (N,) expression of the players' costs J^i
    stationarity_states: ca.SX  # grad_x rows, in the order (T-1, N, n)
    stationarity_controls: ca.SX  # grad_u rows, in the order (T-1, N, m)
    dynamics_error: ca.SX  # F rows, in the order (T-1, N, n)

    @cached_property
    def residual(self) -> ca.SX:
        """G, all rows in one column."""
        return ca.vertcat(self.stationarity_states, self.stationarity_controls, self.dynamics_error)

    @cached_property
    def unknowns(self) -> ca.SX:
        """The unknowns z = (x_2..x_T, u, lambda) of a forward game; as many as G has rows."""
        initial = self.game.num_players * self.game.dynamics.state_size
        return ca.vertcat(self.states[initial:], self.controls, self.costates)

    @cached_property
    def initial_state(self) -> ca.SX:
        """x_1 (N, n), the first part of the states symbol."""
        return self.states[: self.game.num_players * self.game.dynamics.state_size]

    @cached_property
    def residual_function(self) -> ca.Function:
        """G as a function of (states, controls, costates, weights), flat."""
        arguments = [self.states, self.controls, self.costates, self.weights]
        return ca.Function("G", arguments, [self.residual])

    @cached_property
    def cost_function(self) -> ca.Function:
        """The players' costs as a function of (states, controls, weights), flat."""
        return ca.Function("J", [self.states, self.controls, self.weights], [self.costs])


@lru_cache(maxsize=64)
def kkt_system(game: Game) -> KktSystem:
    """Build (or fetch) the first-order conditions of a game; ValueError if it has constraints."""
    refuse_constraints(game.constraints, "the stacked system G")
    states, state_blocks = trajectory_symbols("x", game.state_shape)
    controls, control_blocks = trajectory_symbols("u", game.control_shape)
    costates, costate_blocks = trajectory_symbols(
        "lambda", (game.horizon - 1, game.num_players, game.dynamics.state_size)
    )
    weights = ca.SX.sym("theta", game.num_players * game.num_weights)
    weight_blocks = ca.vertsplit(weights, game.num_weights)

    costs, state_rows, control_rows, errors = [], [], [], []
    for i in range(game.num_players):
        own_controls = [row[i] for row in control_blocks]
        cost = player_cost(game, i, state_blocks, own_controls, weight_blocks[i])
        own_errors = dynamics_errors(
            game.dynamics, [row[i] for row in state_blocks], own_controls, game.dt
        )
        errors.append(own_errors)
        lagrangian = cost + sum(
            ca.dot(costate_blocks[t][i], error) for t, error in enumerate(own_errors)
        )
        own_states = [row[i] for row in state_blocks[1:]]
        gradient = ca.gradient(lagrangian, ca.vertcat(*own_states, *own_controls))
        split = (game.horizon - 1) * game.dynamics.state_size
        state_rows.append(ca.vertsplit(gradient[:split], game.dynamics.state_size))
        control_rows.append(ca.vertsplit(gradient[split:], game.dynamics.control_size))
        costs.append(cost)

    def by_time(rows: list[list[ca.SX]]) -> ca.SX:
        blocks = [block for step_blocks in zip(*rows, strict=True) for block in step_blocks]
        stacked: ca.SX = ca.vertcat(*blocks)
        return stacked

    return KktSystem(
        game=game,
        states=states,
        controls=controls,
        costates=costates,
        weights=weights,
        costs=ca.vertcat(*costs),
        stationarity_states=by_time(state_rows),
        stationarity_controls=by_time(control_rows),
        dynamics_error=by_time(errors),
    )


def kkt_residual_norm(
    game: Game, states: np.ndarray, controls: np.ndarray, costates: np.ndarray, weights: np.ndarray
) -> float:
    """Largest absolute entry of G at a point given as arrays."""
    function = kkt_system(game).residual_function
    residual = function(states.ravel(), controls.ravel(), costates.ravel(), weights.ravel())
    return float(np.abs(np.array(residual)).max())


def consistent_costates(
    game: Game, states: np.ndarray, controls: np.ndarray, weights: np.ndarray
) -> np.ndarray:
    """Costates (T-1, N, n) that make a trajectory stationary in its states.

    The grad_x rows of G are linear in the costates and triangular in time (the adjoint
    recursion), so every trajectory has exactly one such set. The grad_u rows then decide whether it
    is an equilibrium. Rows of constraints have the multipliers of ``newton.pack``.
    """
    solver, nothing = elimination(game), np.zeros_like(states[1:])
    theta, width = np.asarray(weights, dtype=float).ravel(), states[0].size
    z = pack(game, states, controls, nothing, weights, solver)
    for t in range(len(states) - 1, 0, -1):
        z[t - 1, -width:] = -solver.evaluate(z, theta)[t, :width]
    return z[:-1, -width:].reshape(states[1:].shape)
