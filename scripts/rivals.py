"""Rivals that the project's solvers are compared with: whole problems, solved by IPOPT."""

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from olne_bench.estimators.shared.joint_ipopt import joint_solver
from olne_bench.estimators.shared.joint_problem import JointPoint
from olne_bench.estimators.shared.trajectory_fit import observation_parameters, squared_error
from olne_bench.games.model.costs import Stage
from olne_bench.games.model.game import Game, trajectory_symbols
from olne_bench.games.model.observation import View, observation_size
from olne_bench.games.solve.ipopt import QUIET
from olne_bench.games.solve.kkt import kkt_system
from olne_bench.games.solve.newton import Root
from olne_bench.games.solve.olne import Equilibrium

#: Time after which a rival is stopped [s].
TIME_LIMIT = 30.0


@dataclass(frozen=True)
class Outcome:
    """Objective (for forward games the residual) at the end of a rival, and how it ended."""

    value: float
    iterations: int
    converged: bool


class CompactLayout:
    """The joint inverse problem with costates of a player's own states; weights start at zero."""

    def __init__(self, game: Game, view: View) -> None:
        self.solver = joint_solver(game, view, count=1, max_iterations=500, tolerance=1e-9)

    def solve(self, y: np.ndarray, start: JointPoint, floor: float) -> Outcome:
        """Solve from a trajectory, with costates and weights started at zero."""
        count = start.weights.size
        trajectory = [start.states.ravel(), start.controls.ravel(), start.costates.ravel()]
        lower = np.full(sum(part.size for part in trajectory) + count, -np.inf)
        lower[-count:] = floor
        return _outcome(
            self.solver,
            x0=np.concatenate([*trajectory, np.zeros(count)]),
            lbx=lower,
            p=np.append(observation_parameters(y), np.zeros(2 + count)),  # no tie, no prior
        )


class PublishedLayout:
    """The joint inverse problem in the layout of the published code.

    Each player has costates of all players' states. The gradients of the costs and the Jacobians of
    the motion are auxiliary variables with their own equations. Costates and weights start at zero.
    Auxiliary variables start at zero too, or, more favourably than in the published code, at values
    consistent with the start.
    """

    def __init__(self, game: Game, view: View) -> None:
        states, x = trajectory_symbols("x", game.state_shape)
        controls, u = trajectory_symbols("u", game.control_shape)
        weights = ca.SX.sym("theta", game.num_players * game.num_weights)
        layout = _Layout(game, x, u, ca.vertsplit(weights, game.num_weights))
        y = ca.SX.sym("y", game.horizon * game.num_players * observation_size(view, game.dynamics))
        precision = ca.SX.sym("precision", y.numel())
        values = ca.vertcat(*layout.values)
        self.auxiliary = ca.Function("start", [states, controls, weights], [values])
        problem = {
            "x": ca.vertcat(states, controls, *layout.unknowns, weights),
            "p": ca.vertcat(y, precision),
            "f": squared_error(game, view, states, y, precision),
            "g": ca.vertcat(*layout.equations),
        }
        options = QUIET | {
            "ipopt.max_iter": 1000,
            "ipopt.tol": 1e-9,
            "ipopt.max_wall_time": TIME_LIMIT,
        }
        self.solver = ca.nlpsol("published", "ipopt", problem, options)

    def solve(
        self, y: np.ndarray, start: JointPoint, floor: float, *, consistent: bool = True
    ) -> Outcome:
        """Solve from a trajectory; with ``consistent``, auxiliary variables start at its values."""
        states, controls = start.states.ravel(), start.controls.ravel()
        zero = np.zeros(start.weights.size)
        auxiliary = np.array(self.auxiliary(states, controls, zero)).ravel() * consistent
        first = np.concatenate([states, controls, auxiliary, zero])
        lower = np.full(first.size, -np.inf)
        lower[-zero.size :] = floor
        return _outcome(self.solver, x0=first, lbx=lower, p=observation_parameters(y))


class _Layout:
    """Auxiliary variables, their consistent values, and all equations."""

    def __init__(
        self, game: Game, x: list[list[ca.SX]], u: list[list[ca.SX]], theta: list[ca.SX]
    ) -> None:
        self.unknowns: list[ca.SX] = []
        self.values: list[ca.SX] = []
        self.equations: list[ca.SX] = []
        in_states, in_controls = self._motion(game, x, u)
        for i in range(game.num_players):
            self._conditions(game, i, x, u, theta[i], in_states, in_controls)
        self.equations.extend(ca.sum1(row) - 1 for row in theta)

    def _motion(
        self, game: Game, x: list[list[ca.SX]], u: list[list[ca.SX]]
    ) -> tuple[list[ca.SX], list[list[ca.SX]]]:
        """Add equations of motion; return Jacobians in all states and each control, per step."""
        in_states, in_controls = [], []
        for t in range(game.horizon - 1):
            players = range(game.num_players)
            step = [game.dynamics.step(x[t][j], u[t][j], game.dt) for j in players]
            self.equations.append(ca.vertcat(*x[t + 1]) - ca.vertcat(*step))
            own = [_named_entries(self._named, ca.jacobian(step[j], x[t][j])) for j in players]
            in_states.append(ca.diagcat(*own))
            in_controls.append(
                [_named_entries(self._named, ca.jacobian(step[j], u[t][j])) for j in players]
            )
        return in_states, in_controls

    def _conditions(
        self,
        game: Game,
        i: int,
        x: list[list[ca.SX]],
        u: list[list[ca.SX]],
        theta: ca.SX,
        in_states: list[ca.SX],
        in_controls: list[list[ca.SX]],
    ) -> None:
        """Add first-order conditions of one player, with costates of all players' states."""
        n, steps, player = game.dynamics.state_size, game.horizon - 1, game.players[i]
        costates = [self._variable(ca.SX.zeros(n * game.num_players)) for _ in range(steps)]
        for t in range(game.horizon):
            final = t == steps
            stage = Stage(i, tuple(x[t]), None if final else u[t][i], game.dynamics, game.dt)
            cost = (player.final_cost if final else player.running_cost)(stage, theta)
            if not final:
                gradient = self._named(ca.gradient(cost, u[t][i]))
                own = costates[t][i * n : (i + 1) * n]
                self.equations.append(gradient - in_controls[t][i].T @ own)
            if t > 0:
                row = self._named(ca.gradient(cost, ca.vertcat(*x[t]))) + costates[t - 1]
                self.equations.append(row if final else row - in_states[t].T @ costates[t])

    def _variable(self, value: ca.SX) -> ca.SX:
        self.unknowns.append(ca.SX.sym("aux", value.numel()))
        self.values.append(ca.vec(value))
        return self.unknowns[-1]

    def _named(self, expression: ca.SX) -> ca.SX:
        """A variable in place of an expression, unless that is a constant."""
        if expression.is_constant():
            return expression
        name = ca.reshape(self._variable(expression), *expression.shape)
        self.equations.append(ca.vec(name - expression))
        return name


class StackedForward:
    """The forward game: IPOPT on G = 0 without an objective."""

    def __init__(self, game: Game) -> None:
        system = kkt_system(game)
        problem = {
            "x": system.unknowns,
            "p": ca.vertcat(system.initial_state, system.weights),
            "f": ca.SX(0),
            "g": system.residual,
        }
        self.solver = ca.nlpsol("forward", "ipopt", problem, QUIET | {"ipopt.tol": 1e-10})

    def solve(self, start: Root | Equilibrium, weights: np.ndarray) -> Outcome:
        """Solve from a known nearby trajectory."""
        parts = (start.states[1:], start.controls, start.costates)
        return _outcome(
            self.solver,
            x0=np.concatenate([part.ravel() for part in parts]),
            p=np.concatenate([start.states[0].ravel(), weights.ravel()]),
        )


def _named_entries(named: Callable[[ca.SX], ca.SX], matrix: ca.SX) -> ca.SX:
    """A matrix with a variable in place of each entry that is not a constant."""
    matrix = ca.SX(matrix)
    for row in range(matrix.rows()):
        for column in range(matrix.columns()):
            if matrix.has_nz(row, column):
                matrix[row, column] = named(matrix[row, column])
    return matrix


def _outcome(solver: ca.Function, **arguments: np.ndarray) -> Outcome:
    solution = solver(**arguments, lbg=0, ubg=0)
    stats = solver.stats()
    return Outcome(float(solution["f"]), int(stats["iter_count"]), bool(stats["success"]))
