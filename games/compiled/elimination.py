"""Block elimination along time for the first-order conditions, in NumPy.

Every row of G couples neighbouring steps only (names as in ``games.compiled.stage_functions``), so
a linear system with G_z is solved by one backward and one forward sweep in time, as in a Riccati
recursion. The recursion is not symmetric, as each player minimises another cost. With the changes
x, u, lambda of the unknowns at a point and right-hand sides a, b, d of the rows rx, ru, rf:

    (E1)  lambda_{t-1} + Q x_t + P u_t - A' lambda_t = a_t,    lambda_{T-1} + Q_T x_T = a_T
          S x_t + R u_t - B' lambda_t = b_t,    x_{t+1} - A x_t - B u_t = d_t

    (E2)  ansatz lambda_{t-1} = v_t - V_t x_t, with V_T = Q_T, v_T = a_T
    (E3)  M = R + B' V B,   S^ = S + B' V A,   L = P + A' V B,   K = M^-1 S^      (V of t+1)
    (E4)  V_t = Q + A' V A - L K
    (E5)  e = v - V d,   k = M^-1 (b + B' e),   v_t = a + A' e - L k              (v of t+1)
    (E6)  u_t = k - K x_t,   x_{t+1} = A x_t + B u_t + d_t, then lambda backwards by (E1)

The transposed system G_z' (p, q, r) = (a, b, d) has the shape of (E1) with Q', S', P', R', hence
V', M', and L' and S^' change places. The columns of

    (E7)  Z = d(x, u, lambda) / d(x_1, theta) along G = 0

are (E5), (E6) for a = -X, b = -U, d = 0 (weights) and for x_1 = I (initial state). As every
direction along G = 0 is Z times a change of (x_1, theta), the inverse problem's Hessian H is needed
only as

    (E8)  W = Z' H Z.

``games/compiled/elimination.c`` is the same algorithm, compiled. This module is used if there is no
compiler and as the reference in tests of the compiled code. Arrays over time have T rows: z_t =
(x_t, u_t, lambda_t), residuals (rx_t, ru_t, rf_t), multipliers (p_t, q_t, r_t); entries that do not
exist (rx_1, u_T, ...) are zero.
"""

import time
from collections.abc import Callable, Sequence
from functools import partial

import casadi as ca
import numpy as np

from olne_bench.games.compiled.complementarity import RELAXATION, ComplementarityPlace
from olne_bench.games.compiled.constraint_functions import ConstraintFunctions, ConstraintPlace
from olne_bench.games.compiled.stage_functions import StageFunctions, TermFunctions, TermPlace
from olne_bench.games.compiled.stage_patterns import Pattern

#: Smallest step length that Newton's line search tries before it gives up.
SMALLEST_STEP = 2.0**-12

#: A factorisation serves as long as a whole step leaves at most this share of the residual: one
#: costs as much as two or three of the steps that it saves.
ENOUGH = 0.1


class Elimination:
    """Evaluates, factorises and solves one game's first-order conditions.

    An object holds the last factorisation and its work space, so threads must not share it.

    Attributes:
        stages: the stage functions of the game's structure.
        horizon: T.
        numbers: (N, P) numbers of the game (``games.model.numbers``).
        view_numbers: (P,) those of the observation model.
        constraint_numbers: (constraints, P) those of the constraints.
        enforced: (T, C) in which steps each margin is enforced; no control changes x_1. Where
            constraints are equations, of those of (C2) in ``games.compiled.complementarity``.
        relaxation: tau of (C1) there.
    """

    def __init__(
        self,
        stages: StageFunctions,
        horizon: int,
        numbers: np.ndarray,
        view_numbers: np.ndarray,
        constraint_numbers: np.ndarray,
    ) -> None:
        self.stages = stages
        self.horizon = horizon
        self.numbers = numbers
        self.view_numbers = view_numbers
        self.constraint_numbers = constraint_numbers
        self.enforced = _enforced(stages, horizon)
        self.relaxation = RELAXATION
        nx, nu = stages.num_states, stages.num_controls
        self._x, self._u = slice(0, nx), slice(nx, nx + nu)
        self._costate = slice(nx + nu, stages.size)
        self.set_observations(np.zeros((horizon, stages.num_samples)))

    def set_observations(self, y: np.ndarray, noise_scale: np.ndarray | float = 1.0) -> None:
        """Observations (T, N*d), NaN where missing, for the loss and its derivatives.

        ``noise_scale`` (N*d,) holds their relative standard deviations.

        Raises:
            ValueError: on a wrong shape.
        """
        y, noise_scale = np.asarray(y, dtype=float), np.asarray(noise_scale, dtype=float)
        expected = (self.horizon, self.stages.num_samples)
        if y.shape != expected:
            raise ValueError(f"y has the shape {y.shape}, expected {expected}")
        if noise_scale.shape not in ((), (1,), expected[1:]):
            raise ValueError(
                f"noise_scale has the shape {noise_scale.shape}, expected {expected[1:]}"
            )
        seen = np.isfinite(y)
        self._samples = np.where(seen, y, 0.0)
        self._precision = seen / noise_scale

    def evaluate(self, z: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Residual G (T, size) at z (T, size) and weights theta (N*K,)."""
        residual = np.zeros_like(z)
        x, costate = z[:, self._x], z[:-1, self._costate]
        values = self._sum("value", z.shape[1], z[:-1], theta)
        residual[:-1] = values
        residual[:-1, self._costate] = x[1:] - values[:, self._costate]
        residual[-1] = self._sum("final_value", z.shape[1], z[-1:], theta)[0]
        residual[1:, self._x] += costate
        residual[0, self._x] = 0.0  # x_1 is given, not chosen
        return residual

    def costs(self, z: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """The players' costs J^i (N,) along a trajectory (T, size)."""
        stages, found = self.stages, np.zeros(self.stages.num_players)
        for term in stages.terms:
            kind = stages.kinds[term.kind]
            for name, rows in (("cost", z[:-1]), ("final_cost", z[-1:])):
                arguments = self._arguments(kind, term, rows, theta, np.zeros_like(rows))
                found[term.owner] += _map(kind.functions[name], *arguments).sum()
        return found

    def observation_loss(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        """Sum of squared observation errors, and its gradient (T, size)."""
        values = _map(self.stages.loss.value, *self._by_player(z, slice(None)))
        gradient = np.zeros_like(z)
        gradient[:, self._x] = values[:, 1:].reshape(self.horizon, -1)
        return float(values[:, 0].sum()), gradient

    def margins(self, z: np.ndarray) -> np.ndarray:
        """Margins g (T, C) of all constraints along a trajectory (T, size)."""
        return self._constraint_columns("margins", z)

    def push(self, z: np.ndarray, v: np.ndarray) -> np.ndarray:
        """J' v (T, size) for multipliers v (T, C), with J the derivative of the margins."""
        return self._by_constraint("push", z, v)

    def change(self, z: np.ndarray, d: np.ndarray) -> np.ndarray:
        """J d (T, C): how the margins change along a direction (T, size)."""
        return self._constraint_columns("change", z, d)

    def linearise(self, z: np.ndarray, theta: np.ndarray) -> bool:
        """Factorise G_z at a point, (E2) to (E4); False where a stage matrix is singular."""
        self._differentiate(z, theta)
        return self._factorise(partial(_regular, equilibrated=self.stages.num_multipliers > 0))

    def linearise_condensed(
        self, z: np.ndarray, theta: np.ndarray, v: np.ndarray, sigma: np.ndarray, shift: float
    ) -> bool:
        """``linearise`` with J' diag(sigma) J - v' g'' and shift I added to the second derivatives.

        Args:
            z: (T, size).
            theta: (N*K,).
            v: (T, C) multipliers.
            sigma: (T, C) weights.
            shift: what is added to the diagonals of Q and R.

        Returns:
            False unless the symmetric part of every stage matrix M is positive definite.
        """
        self._differentiate(z, theta)
        for place in self.stages.constraints:
            states, control = self._constraint_rows(place)
            sides = {"Q": (states, states), "P": (states, control)}
            sides |= {"S": (control, states), "R": (control, control)}
            stage_blocks = self._blocks, self._final
            for (functions, steps), blocks in zip(self._pair(place), stage_blocks, strict=True):
                arguments = self._constraint_arguments(place, functions, z[steps], v, sigma, steps)
                values = _map(functions.functions["condensed"], *arguments)
                for name, block in _dense_blocks(functions.blocks, _shapes(sides), values).items():
                    rows, columns = sides[name]
                    blocks[name][:, rows[:, None], columns] += block
        for name, block in (*self._blocks.items(), *self._final.items()):
            if name in ("Q", "R"):
                block += shift * np.eye(block.shape[1])
        return self._factorise(_definite)

    def _differentiate(self, z: np.ndarray, theta: np.ndarray) -> None:
        """The stage blocks at a point."""
        stages = self.stages
        sizes = [sum(p.size for p in blocks) for blocks in (stages.blocks, stages.final_blocks)]
        values = self._sum("jacobian", sizes[0], z[:-1], theta)
        final_values = self._sum("final_jacobian", sizes[1], z[-1:], theta)
        shapes = self._block_shapes()
        self._blocks = _dense_blocks(stages.blocks, shapes, values)
        self._final = _dense_blocks(stages.final_blocks, shapes, final_values)

    def _factorise(self, usable: Callable[[np.ndarray], bool]) -> bool:
        """(E2) to (E4); False where a stage matrix is not usable."""
        stages = self.stages
        steps, (nx, nu) = self.horizon - 1, (stages.num_states, stages.num_controls)
        self._V = np.zeros((self.horizon, nx, nx))
        self._M, self._K = np.zeros((steps, nu, nu)), np.zeros((steps, nu, nx))
        self._S, self._L = np.zeros((steps, nu, nx)), np.zeros((steps, nx, nu))
        self._V[-1] = self._final["Q"][0]
        for t in reversed(range(steps)):
            Q, P, S, R, A, B = (self._blocks[name][t] for name in "QPSRAB")
            AV, BV = A.T @ self._V[t + 1], B.T @ self._V[t + 1]
            self._M[t], self._S[t], self._L[t] = R + BV @ B, S + BV @ A, P + AV @ B
            if not usable(self._M[t]):
                return False
            self._K[t] = np.linalg.solve(self._M[t], self._S[t])
            if t > 0:
                self._V[t] = Q + AV @ A - self._L[t] @ self._K[t]
        return True

    def solve(self, right: np.ndarray, *, transposed: bool = False) -> np.ndarray:
        """Solve G_z out = right, or G_z' out = right, with out's x_1 (p_1) zero: (E5), (E6).

        Arrays (T, size).
        """

        def turn(matrix: np.ndarray) -> np.ndarray:
            return matrix.T if transposed else matrix

        swap = {"P": "S", "S": "P"} if transposed else {}
        a, b, d = right[:, self._x], right[:, self._u], right[:, self._costate]
        blocks, out = self._blocks, np.zeros_like(right)
        x, u, costate = out[:, self._x], out[:, self._u], out[:, self._costate]
        v = a[-1]
        for t in reversed(range(self.horizon - 1)):
            A, B = blocks["A"][t], blocks["B"][t]
            e = v - turn(self._V[t + 1]) @ d[t]
            u[t] = b[t] + B.T @ e
            gain = turn(self._S[t] if transposed else self._L[t])
            v = a[t] + A.T @ e - gain @ np.linalg.solve(turn(self._M[t]), u[t])
        for t in range(self.horizon - 1):
            feedback = turn(self._L[t] if transposed else self._S[t])
            u[t] = np.linalg.solve(turn(self._M[t]), u[t] - feedback @ x[t])
            x[t + 1] = blocks["A"][t] @ x[t] + blocks["B"][t] @ u[t] + d[t]
        costate[-2] = a[-1] - turn(self._final["Q"][0]) @ x[-1]
        for t in reversed(range(1, self.horizon - 1)):
            costate[t - 1] = (
                a[t]
                - turn(blocks["Q"][t]) @ x[t]
                - turn(blocks[swap.get("P", "P")][t]) @ u[t]
                + blocks["A"][t].T @ costate[t]
            )
        return out

    def sensitivities(self) -> np.ndarray:
        """Z (T, size, N*n + N*K) of (E7) at the last factorisation; do not write into it."""
        stages = self.stages
        nx, weights = stages.num_states, stages.num_weights
        blocks, steps = self._blocks, self.horizon - 1
        Z = np.zeros((self.horizon, stages.size, nx + weights))
        Zx, Zu, Zcostate = Z[:, self._x], Z[:, self._u], Z[:, self._costate]
        v = -self._final["X"][0]
        for t in reversed(range(steps)):
            k = np.linalg.solve(self._M[t], blocks["B"][t].T @ v - blocks["U"][t])
            Zu[t, :, nx:] = k
            v = blocks["A"][t].T @ v - blocks["X"][t] - self._L[t] @ k
        Zx[0, :, :nx] = np.eye(nx)
        for t in range(steps):
            Zu[t] -= self._K[t] @ Zx[t]
            Zx[t + 1] = blocks["A"][t] @ Zx[t] + blocks["B"][t] @ Zu[t]
        Zcostate[-2] = -self._final["Q"][0] @ Zx[-1]
        Zcostate[-2, :, nx:] -= self._final["X"][0]
        for t in reversed(range(1, steps)):
            Zcostate[t - 1] = (
                blocks["A"][t].T @ Zcostate[t] - blocks["Q"][t] @ Zx[t] - blocks["P"][t] @ Zu[t]
            )
            Zcostate[t - 1, :, nx:] -= blocks["X"][t]
        self._Z = Z
        return Z

    def reduced_hessian(
        self, z: np.ndarray, theta: np.ndarray, multipliers: np.ndarray
    ) -> np.ndarray:
        """W (E8) of loss + multipliers' G, after ``sensitivities``: (N*n + N*K,) squared."""
        stages = self.stages
        width = stages.size + stages.num_weights
        half = np.zeros((self.horizon, width, width))
        for name, pattern, steps, place in (
            ("hessian", stages.curvature, slice(None, -1), 0),
            ("final_hessian", stages.final_curvature, slice(-1, None), 1),
        ):
            values = self._sum(name, pattern.size, z[steps], theta, multipliers[steps])
            losses = _map(stages.loss.hessian, *self._by_player(z, steps))
            losses = losses.reshape(len(values), stages.num_players, -1)
            for i, places in enumerate(stages.loss_indices):
                values[:, places[place]] += losses[:, i]
            half[steps, pattern.rows, pattern.columns] = values
        self._H = half + half.transpose(0, 2, 1)
        constant = np.eye(stages.num_weights, self._Z.shape[2], stages.num_states)
        full = np.concatenate(
            [self._Z, np.broadcast_to(constant, (self.horizon, *constant.shape))], 1
        )
        return np.tensordot(full, self._H @ full, axes=([0, 1], [0, 1]))

    def trajectory_metric(self) -> np.ndarray:
        """Z'Z over states and controls: (N*n + N*K,) squared."""
        Z = self._Z[:, : self._costate.start]
        return np.tensordot(Z, Z, axes=([0, 1], [0, 1]))

    def hessian_product(self, d: np.ndarray, d_theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """H times a direction, with the Hessian of the last ``reduced_hessian``."""
        size = self.stages.size
        direction = np.concatenate([d, np.broadcast_to(d_theta, (self.horizon, len(d_theta)))], 1)
        product = np.matmul(self._H, direction[..., None])[..., 0]
        return np.ascontiguousarray(product[:, :size]), product[:, size:].sum(axis=0)

    def reduce(self, g: np.ndarray) -> np.ndarray:
        """Z' g for g (T, size)."""
        return np.tensordot(g, self._Z, axes=2)

    def expand(self, d: np.ndarray) -> np.ndarray:
        """Z d for d (N*n + N*K,) = (x_1, theta)."""
        return self._Z @ d

    def newton(
        self,
        z: np.ndarray,
        theta: np.ndarray,
        *,
        tolerance: float,
        max_iterations: int,
        limit: float,
        factorised: bool = False,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Damped Newton on G = 0 for a batch, in place.

        Args:
            z: (B, T, size) starts, overwritten by the best points reached; x_1 stays.
            theta: (B, N*K).
            tolerance: stop once max |G| falls below.
            max_iterations: factorisations per game at most.
            limit: wall-clock seconds for the batch.
            factorised: whether the last factorisation is of a point near the starts. It then serves
                first, as each serves until its steps leave too much of the residual (``ENOUGH``).

        Returns:
            max |G| (B,) and the number of factorisations (B,).
        """
        deadline = time.monotonic() + limit
        again = factorised
        residuals, iterations = np.empty(len(z)), np.zeros(len(z), dtype=np.int32)
        for b, (point, weights) in enumerate(zip(z, theta, strict=True)):
            residual = self.evaluate(point, weights)
            while not (largest := np.abs(residual).max()) < tolerance:
                if not np.isfinite(largest) or time.monotonic() > deadline:
                    break
                before = np.linalg.norm(residual)
                if again:
                    found = self._newton_step(point, weights, residual, 1.0)
                    again = found is not None
                else:
                    if iterations[b] == max_iterations or not self.linearise(point, weights):
                        break
                    iterations[b] += 1
                    found = self._newton_step(point, weights, residual, SMALLEST_STEP)
                    if found is None:
                        break
                    again = True
                residual = residual if found is None else found
                again = again and bool(np.linalg.norm(residual) < ENOUGH * before)
            residuals[b] = largest
        return residuals, iterations

    def _newton_step(
        self, z: np.ndarray, theta: np.ndarray, residual: np.ndarray, shortest: float
    ) -> np.ndarray | None:
        """Move z by a step that reduces the residual; returns the new one, or None."""
        step, length = self.solve(residual), 1.0
        while length >= shortest:
            trial = z - length * step
            found = self.evaluate(trial, theta)
            # NaN compares false, so an undefined trial point is refused as well.
            if np.linalg.norm(found) < (1 - 1e-4 * length) * np.linalg.norm(residual):
                z[:] = trial
                return found
            length /= 2
        return None

    def _sum(
        self,
        name: str,
        size: int,
        z: np.ndarray,
        theta: np.ndarray,
        multipliers: np.ndarray | None = None,
    ) -> np.ndarray:
        """Values (steps, size) of one function, summed over all terms, at rows z (steps, SZ)."""
        stages, out = self.stages, np.zeros((len(z), size))
        multipliers = np.zeros_like(z) if multipliers is None else multipliers
        for index, kind in enumerate(stages.kinds):
            terms = [term for term in stages.terms if term.kind == index]
            places = np.concatenate([term.indices[name] for term in terms])
            columns = [self._arguments(kind, term, z, theta, multipliers) for term in terms]
            stacked = [np.concatenate(parts) for parts in zip(*columns, strict=True)]
            values = np.array(_map(kind.functions[name], *stacked))
            by_step = values.reshape(len(terms), len(z), -1).transpose(1, 0, 2)
            for step, row in zip(out, by_step.reshape(len(z), -1), strict=True):
                np.add.at(step, places, row)
        if not name.startswith("final"):
            for place in stages.complementarities:
                values = self._complementarity(place, name, z, theta, multipliers)
                for step, row in zip(out, values, strict=True):
                    np.add.at(step, place.indices[name], row)
        return out

    def step_margins(self, z: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Margins h (T-1, C) of (C2) where constraints are equations; z (T, size)."""
        columns = [
            self._complementarity(place, "margins", z[:-1], theta, z[:-1])
            for place in self.stages.complementarities
        ]
        return np.hstack([np.zeros((self.horizon - 1, 0)), *columns])

    def _complementarity(
        self,
        place: ComplementarityPlace,
        name: str,
        z: np.ndarray,
        theta: np.ndarray,
        multipliers: np.ndarray,
    ) -> np.ndarray:
        """Values (steps, k) of one function of a constraint that is an equation."""
        stages, steps = self.stages, len(z)
        functions = stages.complementarity_kinds[place.kind]
        n, m = self._n, stages.own_controls
        states, controls = (
            np.concatenate([np.arange(j * size, (j + 1) * size) for j in place.players])
            for size in (n, m)
        )
        own = place.offset + np.arange(functions.num_margins)
        inputs = self._u.start + np.concatenate([controls, stages.num_players * m + own])
        index = stages.complementarities.index(place)
        numbers = self.constraint_numbers[index, : functions.num_numbers]
        constants = numbers, [self.relaxation], theta[place.theta]
        arguments = [
            z[:, states],
            z[:, inputs[: controls.size]],
            z[:, inputs[controls.size :]],
            self.enforced[:steps, own].astype(float),
            *(np.broadcast_to(constant, (steps, len(constant))) for constant in constants),
            multipliers[:, states],
            multipliers[:, inputs],
        ]
        return _map(functions.functions[name], *arguments)

    def _arguments(
        self,
        kind: TermFunctions,
        term: TermPlace,
        z: np.ndarray,
        theta: np.ndarray,
        multipliers: np.ndarray,
    ) -> list[np.ndarray]:
        """Arguments (steps, k) of the functions of one term."""
        steps, count, owner = len(z), self.stages.num_players, term.owner

        inputs = slice(self._u.start, self._u.stop - self.stages.num_multipliers)

        def own(rows: np.ndarray, part: slice) -> np.ndarray:
            return np.split(rows[:, part], count, axis=1)[owner]

        states = np.split(z[:, self._x], count, axis=1)
        own_theta = np.split(theta, count)[owner][: kind.kind.num_theta]
        constants = [own_theta, self.numbers[owner, : kind.num_numbers]]
        return [
            np.concatenate([states[j] for j in term.players], axis=1),
            *(own(z, part) for part in (inputs, self._costate)),
            *(np.broadcast_to(constant, (steps, constant.size)) for constant in constants),
            *(own(multipliers, part) for part in (self._x, inputs, self._costate)),
        ]

    def _by_constraint(self, name: str, z: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Rows (T, size) of the states and controls of constraints, summed over all of them."""
        out, zero = np.zeros_like(z), np.zeros_like(v)
        for place in self.stages.constraints:
            rows = np.concatenate(self._constraint_rows(place))
            rows[len(place.players) * self._n :] += self._u.start
            for functions, steps in self._pair(place):
                arguments = self._constraint_arguments(place, functions, z[steps], v, zero, steps)
                values = _map(functions.functions[name], *arguments)
                out[steps, rows[: values.shape[1]]] += values
        return out

    def _constraint_columns(
        self, name: str, z: np.ndarray, d: np.ndarray | None = None
    ) -> np.ndarray:
        """Columns (T, C), a constraint's own ones each; zero where it has no margins."""
        out = np.zeros((self.horizon, self.stages.num_margins))
        for place in self.stages.constraints:
            for functions, steps in self._pair(place):
                own = slice(place.offset, place.offset + functions.num_margins)
                arguments = self._constraint_arguments(
                    place, functions, z[steps], out, out, steps, None if d is None else d[steps]
                )
                out[steps, own] = _map(functions.functions[name], *arguments)
        return out

    def _pair(self, place: ConstraintPlace) -> list[tuple[ConstraintFunctions, slice]]:
        """The functions of a constraint, and the steps that they are for."""
        pair = self.stages.constraint_kinds[place.kind]
        return [(pair[0], slice(None, -1)), (pair[1], slice(-1, None))]

    @property
    def _n(self) -> int:
        return self.stages.num_states // self.stages.num_players

    def _constraint_rows(self, place: ConstraintPlace) -> tuple[np.ndarray, np.ndarray]:
        """Which states and which controls of the game a constraint looks at."""
        n, m = self._n, self.stages.own_controls
        states = np.concatenate([np.arange(j * n, (j + 1) * n) for j in place.players])
        return states, np.arange(place.players[0] * m, (place.players[0] + 1) * m)

    def _constraint_arguments(
        self,
        place: ConstraintPlace,
        functions: ConstraintFunctions,
        z: np.ndarray,
        v: np.ndarray,
        sigma: np.ndarray,
        steps: slice,
        d: np.ndarray | None = None,
    ) -> list[np.ndarray]:
        """Arguments (steps, k) of one constraint's functions; z and d have those steps only."""
        states, control = self._constraint_rows(place)
        control = (self._u.start + control)[: functions.functions["margins"].numel_in(1)]
        own = slice(place.offset, place.offset + functions.num_margins)
        index = self.stages.constraints.index(place)
        numbers = self.constraint_numbers[index, : functions.num_numbers]
        direction = z if d is None else d
        return [
            z[:, states],
            z[:, control],
            np.broadcast_to(numbers, (len(z), numbers.size)),
            v[steps, own],
            sigma[steps, own],
            direction[:, np.concatenate([states, control])],
        ]

    def _by_player(self, z: np.ndarray, steps: slice) -> list[np.ndarray]:
        """States, samples, precision and the view's numbers: a row for each step and player."""
        rows = z[steps, self._x], self._samples[steps], self._precision[steps]
        count = len(rows[0]) * self.stages.num_players
        constant = np.broadcast_to(self.view_numbers, (count, self.view_numbers.size))
        return [*(row.reshape(count, -1) for row in rows), constant]

    def _block_shapes(self) -> dict[str, tuple[int, int]]:
        nx, nu = self.stages.num_states, self.stages.num_controls
        weights = self.stages.num_weights
        return {
            "Q": (nx, nx),
            "P": (nx, nu),
            "X": (nx, weights),
            "S": (nu, nx),
            "R": (nu, nu),
            "U": (nu, weights),
            "A": (nx, nx),
            "B": (nx, nu),
        }


def _map(function: ca.Function, *arguments: np.ndarray) -> np.ndarray:
    """Values (steps, m) of a function; arguments (steps, k)."""
    columns = [argument.T for argument in arguments]
    return np.array(function.map(len(arguments[0]))(*columns)).T


def _dense_blocks(
    patterns: Sequence[Pattern], shapes: dict[str, tuple[int, int]], values: np.ndarray
) -> dict[str, np.ndarray]:
    """Blocks (steps, rows, columns) by name, from their nonzeros (steps, count)."""
    blocks, offset = {}, 0
    for pattern in patterns:
        block = np.zeros((len(values), *shapes[pattern.name]))
        block[:, pattern.rows, pattern.columns] = values[:, offset : offset + pattern.size]
        blocks[pattern.name] = block
        offset += pattern.size
    return blocks


def _shapes(
    sides: dict[str, tuple[np.ndarray, np.ndarray]],
) -> dict[str, tuple[int, int]]:
    return {name: (len(rows), len(columns)) for name, (rows, columns) in sides.items()}


def _enforced(stages: StageFunctions, horizon: int) -> np.ndarray:
    """(T, C) in which steps each margin is enforced; see ``Elimination``."""
    if stages.complementarities:
        enforced = np.zeros((horizon, stages.num_multipliers), dtype=bool)
        for one in stages.complementarities:
            for k, after in enumerate(stages.complementarity_kinds[one.kind].after):
                enforced[max(0, one.first_step - after) : -1, one.offset + k] = True
        return enforced
    enforced = np.zeros((horizon, stages.num_margins), dtype=bool)
    for place in stages.constraints:
        pair = stages.constraint_kinds[place.kind]
        for k, needs_control in enumerate(pair[0].needs_control):
            first = place.first_step if needs_control else max(place.first_step, 1)
            enforced[first:-1, place.offset + k] = True
        enforced[-1, place.offset : place.offset + pair[1].num_margins] = True
    return enforced


def _definite(matrix: np.ndarray) -> bool:
    """Whether the symmetric part of a stage matrix is positive definite to working precision."""
    if not np.isfinite(matrix).all():
        return False
    return bool(np.linalg.eigvalsh(matrix + matrix.T)[0] > 1e-13 * np.abs(matrix).max())


def _regular(matrix: np.ndarray, *, equilibrated: bool = False) -> bool:
    """Whether a stage matrix is finite and not singular to working precision.

    Rows of complementarity are tiny where constraints are active: then rows are scaled first.
    """
    if not np.isfinite(matrix).all():
        return False
    largest = np.abs(matrix).max(axis=1, keepdims=True)
    if not (largest > 0).all():
        return False
    return bool(np.linalg.cond(matrix / largest if equilibrated else matrix) < 1e14)
