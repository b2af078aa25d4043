"""Costs and motions of a game to second order at each step of a motion, for all players at once."""

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from olne_bench.games.compiled.row_functions import RowFunction, row_functions
from olne_bench.games.model.game import Game
from olne_bench.games.model.numbers import Structure, structure_and_numbers, with_symbols
from olne_bench.games.model.stage_costs import written_costs


@dataclass(frozen=True)
class Expansion:
    """Derivatives in (x, u), all players' states and controls, at each of T-1 steps and at the end.

    Player j's next state depends on its own state and control alone; ``bends`` are in these.
    """

    costs: np.ndarray  # (N,) of the motion
    motion: np.ndarray  # (T-1, Nn, Nn + Nm) [A B]
    squares: np.ndarray  # (T-1, N, Nn + Nm, Nn + Nm) H of each player's cost
    slopes: np.ndarray  # (T-1, N, Nn + Nm) g
    bends: np.ndarray  # (T-1, N, n, n + m, n + m) f'' of each component of each player's next state
    final_squares: np.ndarray  # (N, Nn, Nn)
    final_slopes: np.ndarray  # (N, Nn)


class Expansions:
    """Expansions of a game at certain weights."""

    def __init__(self, game: Game, theta: np.ndarray) -> None:
        structure, numbers = structure_and_numbers(game)
        self._known = theta.ravel(), numbers.ravel()
        self._functions, self._dt = _functions(structure, game.horizon - 1), game.dt
        self._count = game.num_players
        self._sizes = game.dynamics.state_size, game.dynamics.control_size

    def roll(self, x: np.ndarray, u: np.ndarray, gains: np.ndarray, less: np.ndarray) -> np.ndarray:
        """The motion (T, Nn) of controls u - gains (x' - x) - less, (T-1, Nm) at x', from x_1."""
        given = x[0], x[:-1], u, gains, less, np.full(len(u), self._dt)
        after = self._functions.roll(*(one[None] for one in given))
        return np.vstack([x[0], after.reshape(len(u), -1)])

    def rows(
        self, x: np.ndarray, u: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]]:
        """At x (T, Nn), u (T-1, Nm): ``motion, squares, slopes, bends`` of each step in a row.

        Also ``costs``, and ``final_squares`` and ``final_slopes`` as flat arrays.
        """
        known = [np.tile(one, (len(u), 1)) for one in self._known]
        parts = self._functions.steps(x[:-1], u, *known)
        last = self._functions.final(x[-1:], *(one[:1] for one in known))[0]
        final, Z, zeta = np.split(last, [self._count, self._count * (1 + x.shape[1] ** 2)])
        costs = parts[:, : self._count].sum(axis=0) + final
        return parts[:, self._count :], costs, (Z.copy(), zeta.copy())

    def at(self, x: np.ndarray, u: np.ndarray) -> Expansion:
        """The expansion at a motion x (T, Nn), u (T-1, Nm)."""
        parts, costs, (Z, zeta) = self.rows(x, u)
        count, (n, m) = self._count, self._sizes
        states, both, own = count * n, count * (n + m), n + m
        shapes = (states, both), (count, both, both), (count, both), (count, n, own, own)
        ends = np.cumsum([np.prod(shape) for shape in shapes])[:-1]
        cut = np.split(parts, ends, axis=1)
        motion, squares, slopes, bends = (
            part.reshape(len(u), *shape) for part, shape in zip(cut, shapes, strict=True)
        )
        final = Z.reshape(count, states, states), zeta.reshape(count, states)
        return Expansion(costs, motion, squares, slopes, bends, *final)


@dataclass(frozen=True)
class _Functions:
    """Compiled expressions of a game."""

    steps: RowFunction  # (x, u, theta, numbers) -> costs, [A B], H, g, f''; rows are steps
    final: RowFunction  # (x_T, theta, numbers) -> costs, H, g
    roll: RowFunction  # (x_1, x, u, P, less, dt) of a motion -> all next states


@lru_cache(maxsize=32)
def _functions(structure: Structure, steps: int) -> _Functions:
    count, dynamics = len(structure.players), structure.dynamics
    n, m, each = dynamics.state_size, dynamics.control_size, structure.num_theta
    x, u = ca.SX.sym("x", count * n), ca.SX.sym("u", count * m)
    theta = ca.SX.sym("theta", count * each)
    numbers = ca.SX.sym("numbers", count * structure.num_numbers)
    rows, plans = ca.vertsplit(x, n), ca.vertsplit(u, m)
    weights, own = ca.vertsplit(theta, each), ca.vertsplit(numbers, structure.num_numbers)
    dt = numbers[0]
    after = [dynamics.step(a, b, dt) for a, b in zip(rows, plans, strict=True)]
    players = [with_symbols(p, known[1:]) for p, known in zip(structure.players, own, strict=True)]
    running, final = written_costs(players, rows, plans, weights, dynamics, dt)
    motion, both = ca.vertcat(*after), ca.vertcat(x, u)
    bends = [
        ca.hessian(part, ca.vertcat(a, b))[0]
        for moved, a, b in zip(after, rows, plans, strict=True)
        for part in ca.vertsplit(moved)
    ]
    squares, slopes = zip(*(ca.hessian(cost, both) for cost in running), strict=True)
    ends, pulls = zip(*(ca.hessian(cost, x) for cost in final), strict=True)
    parts = _column(*running, ca.jacobian(motion, both).T, *squares, *slopes, *bends)
    gain, less = ca.SX.sym("P", count * n * count * m), ca.SX.sym("less", count * m)
    now = ca.SX.sym("now", count * n)
    control = u - ca.reshape(gain, count * n, count * m).T @ (now - x) - less
    moved = ca.Function("motion", [x, u, dt], [motion])(now, control, dt)
    roll = ca.Function("step", [now, x, u, gain, less, dt], [moved])
    known, last = [theta, numbers], _column(*final, *ends, *pulls)
    functions = (
        ca.Function("parts", [x, u, *known], [parts]),
        ca.Function("final", [x, *known], [last]),
        roll.mapaccum("rolled", steps),
    )
    # Optimising the long code of second derivatives takes longer than it saves.
    return _Functions(*row_functions(functions, "-O1"))


def _column(*parts: ca.SX) -> ca.SX:
    return ca.densify(ca.vertcat(*map(ca.vec, map(ca.densify, parts))))
