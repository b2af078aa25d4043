"""Block elimination along time for the first-order conditions, in NumPy.

Every row of G couples neighbouring steps only (names as in ``games.stage_functions``), so a linear
system with G_z is solved by one backward and one forward sweep in time, as in a Riccati recursion.
The recursion is not symmetric, as each player minimises another cost. With the changes x, u, lambda
of the unknowns at a point and right-hand sides a, b, d of the rows rx, ru, rf:

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

``games/elimination.c`` is the same algorithm, compiled. This module is used if there is no compiler
and as the reference in tests of the compiled code. Arrays over time have T rows:
z_t = (x_t, u_t, lambda_t), residuals (rx_t, ru_t, rf_t), multipliers (p_t, q_t, r_t); entries that
do not exist (rx_1, u_T, ...) are zero.
"""

import time
from collections.abc import Sequence

import casadi as ca
import numpy as np

from olne_bench.games.stage_functions import Pattern, StageFunctions

#: Smallest step length that Newton's line search tries before it gives up.
SMALLEST_STEP = 2.0**-12


class Elimination:
    """Evaluates, factorises and solves one game's first-order conditions.

    An object holds the last factorisation and its work space, so threads must not share it.

    Attributes:
        stages: the game's stage functions.
        horizon: T.
    """

    def __init__(self, stages: StageFunctions, horizon: int) -> None:
        self.stages = stages
        self.horizon = horizon
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
        x, u, costate = z[:, self._x], z[:-1, self._u], z[:-1, self._costate]
        values = _map(self.stages.value, x[:-1], u, costate, theta)
        residual[:-1] = values
        residual[:-1, self._costate] = x[1:] - values[:, self._costate]
        residual[-1, self._x] = _map(self.stages.final_value, x[-1:], theta)[0]
        residual[1:, self._x] += costate
        residual[0, self._x] = 0.0  # x_1 is given, not chosen
        return residual

    def observation_loss(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        """Sum of squared observation errors, and its gradient (T, size)."""
        values = _map(self.stages.loss, z[:, self._x], self._samples, self._precision)
        gradient = np.zeros_like(z)
        gradient[:, self._x] = values[:, 1:]
        return float(values[:, 0].sum()), gradient

    def linearise(self, z: np.ndarray, theta: np.ndarray) -> bool:
        """Factorise G_z at a point, (E2) to (E4); False where a stage matrix is singular."""
        stages = self.stages
        x, u, costate = z[:, self._x], z[:-1, self._u], z[:-1, self._costate]
        values = _map(stages.jacobian, x[:-1], u, costate, theta)
        final_values = _map(stages.final_jacobian, x[-1:], theta)
        shapes = self._block_shapes()
        self._blocks = _dense_blocks(stages.blocks, shapes, values)
        self._final = _dense_blocks(stages.final_blocks, shapes, final_values)

        steps, (nx, nu) = self.horizon - 1, (stages.num_states, stages.num_controls)
        self._V = np.zeros((self.horizon, nx, nx))
        self._M, self._K = np.zeros((steps, nu, nu)), np.zeros((steps, nu, nx))
        self._S, self._L = np.zeros((steps, nu, nx)), np.zeros((steps, nx, nu))
        self._V[-1] = self._final["Q"][0]
        for t in reversed(range(steps)):
            Q, P, S, R, A, B = (self._blocks[name][t] for name in "QPSRAB")
            AV, BV = A.T @ self._V[t + 1], B.T @ self._V[t + 1]
            self._M[t], self._S[t], self._L[t] = R + BV @ B, S + BV @ A, P + AV @ B
            if not _regular(self._M[t]):
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
        x, u, costate = z[:, self._x], z[:-1, self._u], z[:-1, self._costate]
        p, q, r = (multipliers[:, part] for part in (self._x, self._u, self._costate))
        y, precision = self._samples, self._precision
        width = stages.size + stages.num_weights
        half = np.zeros((self.horizon, width, width))
        half[:-1, stages.curvature.rows, stages.curvature.columns] = _map(
            stages.hessian,
            x[:-1],
            u,
            costate,
            theta,
            p[:-1],
            q[:-1],
            r[:-1],
            y[:-1],
            precision[:-1],
        )
        half[-1, stages.final_curvature.rows, stages.final_curvature.columns] = _map(
            stages.final_hessian, x[-1:], theta, p[-1:], y[-1:], precision[-1:]
        )[0]
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
    ) -> tuple[np.ndarray, np.ndarray]:
        """Damped Newton on G = 0 for a batch, in place.

        Args:
            z: (B, T, size) starts, overwritten by the best points reached; x_1 stays.
            theta: (B, N*K).
            tolerance: stop once max |G| falls below.
            max_iterations: factorisations per game at most.
            limit: wall-clock seconds for the batch.

        Returns:
            max |G| (B,) and the number of factorisations (B,).
        """
        deadline = time.monotonic() + limit
        results = [
            self._newton(start, weights, tolerance, max_iterations, deadline)
            for start, weights in zip(z, theta, strict=True)
        ]
        residuals, iterations = zip(*results, strict=True) if results else ((), ())
        return np.array(residuals, dtype=float), np.array(iterations, dtype=np.int32)

    def _newton(
        self,
        z: np.ndarray,
        theta: np.ndarray,
        tolerance: float,
        max_iterations: int,
        deadline: float,
    ) -> tuple[float, int]:
        residual = self.evaluate(z, theta)
        for iteration in range(max_iterations):
            largest = np.abs(residual).max()
            done = largest < tolerance or not np.isfinite(largest)
            if done or time.monotonic() > deadline or not self.linearise(z, theta):
                return largest, iteration
            step = self.solve(residual)
            length = 1.0
            while True:
                trial = z - length * step
                trial_residual = self.evaluate(trial, theta)
                # NaN compares false, so an undefined trial point is refused as well.
                decrease = (1 - 1e-4 * length) * np.linalg.norm(residual)
                if np.linalg.norm(trial_residual) < decrease:
                    break
                length /= 2
                if length < SMALLEST_STEP:
                    return largest, iteration
            z[:], residual = trial, trial_residual
        return np.abs(residual).max(), max_iterations

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
    """Values (steps, m) of a stage function; arguments (steps, k), or (k,) for all steps."""
    steps = len(arguments[0])
    columns = [
        np.repeat(argument[:, None], steps, axis=1) if argument.ndim == 1 else argument.T
        for argument in arguments
    ]
    return np.array(function.map(steps)(*columns)).T if steps > 1 else _call(function, columns)


def _call(function: ca.Function, columns: list[np.ndarray]) -> np.ndarray:
    return np.array(function(*columns)).T


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


def _regular(matrix: np.ndarray) -> bool:
    """Whether a stage matrix is finite and not singular to working precision."""
    if not np.isfinite(matrix).all():
        return False
    return bool(np.linalg.cond(matrix) < 1e14)
