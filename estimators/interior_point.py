"""A primal-dual interior-point method for the joint inverse problem, on the game's elimination.

    min_{theta, z}  f(z) = sum_t |y_t - h(x_t)|^2
    s.t.  G(z; theta) = 0,  sum theta^i = 1,  theta^i >= floor          (eqn. inverse_approach)

The method is that of IPOPT (Waechter and Biegler 2006; equation numbers below are theirs): a
monotone barrier on the bounds, exact second derivatives, inertia correction and a filter line
search with second-order corrections. What differs is the linear algebra. G_z is square, so a step
splits into a part that restores G = 0 at fixed w = (x_1, theta) and a part along G = 0,

    dz = -G_z^-1 G + Z dw,      Z' H Z dw = -Z' (grad f - H G_z^-1 G) - barrier terms,

where Z and the products with G_z^-1 come from one sweep over time (``games.elimination``). Only a
system of the size of w, N n + N (K - 1), is dense. It is positive definite exactly where the full
system has the inertia of a minimum. Weights move on the tangent of their sums from a start that
fulfils them. Restoration, where the line search fails, is Newton's method on G = 0 at fixed w.

``interior_point.c`` is the same method, compiled; it serves where there is a compiler.
"""

import ctypes
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files

import numpy as np
from scipy.linalg import block_diag, null_space
from scipy.linalg.lapack import dpotrf, dpotrs

from olne_bench.estimators.joint_problem import JointPoint, JointSolution
from olne_bench.games.elimination import Elimination
from olne_bench.games.game import Game
from olne_bench.games.native import NativeElimination, elimination
from olne_bench.games.newton import pack, unpack
from olne_bench.games.observation import View

_FEASIBLE = 1e-9
_ACCEPTABLE = 1e-6  # where rounding forbids more
_BARRIER_FACTORS = (0.2, 1.5)  # kappa_mu, theta_mu of (7)
_BARRIER_ACCURACY = 10.0  # kappa_epsilon
_MULTIPLIER_RANGE = 1e10  # kappa_Sigma of (16)
_MAX_CORRECTIONS = 4  # second-order corrections per iteration
_KNOWN_CHANGE, _KNOWN_WEIGHTS = 1e-4, 1e-3  # of the objective, relative, and of any weight
_FIRST_SHIFT, _SMALLEST_SHIFT, _LARGEST_SHIFT = 1e-4, 1e-20, 1e20

#: Message of a run that stopped because it came close to a known optimum.
CLOSE_TO_KNOWN = "close to a known optimum"

#: Why a run stopped, in the order of the status codes of the native code.
_STOPPED = (
    "",
    "the start is not finite",
    "singular stage of the first-order conditions",
    "time limit reached",
    "the Hessian could not be corrected",
    "line search and restoration failed",
    "iteration limit reached",
    CLOSE_TO_KNOWN,
)
_NATIVE_SOURCE = files("olne_bench.estimators").joinpath("interior_point.c").read_text()


class _Options(ctypes.Structure):
    """What a run is told; mirrors ``Options`` of ``interior_point.c``."""

    _fields_ = (
        ("players", ctypes.c_int),
        ("max_iterations", ctypes.c_int),
        ("known", ctypes.c_int),
        ("floor", ctypes.c_double),
        ("tie", ctypes.c_double),
        ("first_barrier", ctypes.c_double),
        ("tolerance", ctypes.c_double),
        ("limit", ctypes.c_double),
        ("known_change", ctypes.c_double),
        ("known_weights", ctypes.c_double),
        ("known_objectives", ctypes.c_void_p),
        ("known_theta", ctypes.c_void_p),
    )


def solve_joint(
    game: Game,
    view: View,
    y: np.ndarray,
    start: JointPoint,
    *,
    noise_scale: Sequence[float] = (),
    weight_floor: float = 1e-5,
    first_barrier: float = 0.1,
    tie: float = 0.0,
    tolerance: float = 1e-9,
    known: Sequence[JointSolution] = (),
    max_iterations: int = 300,
    limit: float = 60.0,
) -> JointSolution:
    """Solve the joint problem from one start.

    Args:
        game: the game.
        view: the observation model.
        y: (T, N, d) observations, NaN where missing.
        start: its weights lie above the floor and have row sums of one.
        noise_scale: (d,) relative standard deviations of the observations; ones where absent.
        weight_floor: lower bound of every weight, below 1/K.
        first_barrier: barrier parameter to begin with.
        tie: factor of a further term |theta - 1/K|^2 of the objective, which holds the weights
            near uniform.
        tolerance: on all optimality conditions.
        known: optima already found. A run that comes close to one stops there and has not
            converged: it brings nothing new.
        max_iterations: iterations at most.
        limit: wall-clock seconds at most.

    Raises:
        ValueError: if no weights fulfil the bound.
    """
    if not 0 <= weight_floor * game.num_weights < 1:
        raise ValueError(
            f"weight_floor must be in [0, {1 / game.num_weights:g}) for "
            f"{game.num_weights} weights per player, got {weight_floor}"
        )
    solver = joint_elimination(game, view)
    scale = np.tile(noise_scale, game.num_players) if len(noise_scale) else np.ones(1)
    solver.set_observations(y.reshape(game.horizon, -1), scale)
    z = pack(game, start.states, start.controls, start.costates)
    theta = np.array(start.weights, dtype=float).ravel()
    known_objectives = np.array([solution.objective for solution in known])
    known_theta = np.array([solution.point.weights.ravel() for solution in known])
    options = _Options(
        players=game.num_players,
        max_iterations=max_iterations,
        known=len(known),
        floor=weight_floor,
        tie=tie,
        first_barrier=first_barrier,
        tolerance=tolerance,
        limit=limit,
        known_change=_KNOWN_CHANGE,
        known_weights=_KNOWN_WEIGHTS,
        known_objectives=known_objectives.ctypes.data,
        known_theta=known_theta.ctypes.data,
    )
    if isinstance(solver, NativeElimination):
        status, objective, iterations = _run_native(game, solver, options, z, theta)
    else:
        method = _InteriorPoint(game, solver, options, known_objectives, known_theta)
        with np.errstate(all="ignore"):  # trial points may overflow; they are then refused
            status, iterations = method.run(z, theta)
        z, theta, objective = method.point.z, method.point.theta, method.point.objective
    return JointSolution(
        point=JointPoint(*unpack(game, z), theta.reshape(start.weights.shape)),
        objective=objective,
        iterations=iterations,
        converged=not status,
        message=status,
    )


def joint_elimination(game: Game, view: View) -> Elimination:
    """Build (or fetch) what ``solve_joint`` works with."""
    return elimination(game, view, _NATIVE_SOURCE)


def _run_native(
    game: Game, solver: NativeElimination, options: _Options, z: np.ndarray, theta: np.ndarray
) -> tuple[str, float, int]:
    """Improve z and theta in place; why it stopped, objective, iterations."""
    run, space_needed = solver.library.interior_point, solver.library.interior_point_space
    run.argtypes = [ctypes.c_void_p] * 8
    basis = _sum_free(game.num_weights)
    space = np.empty(space_needed(game.horizon, options.max_iterations))
    objective, iterations = ctypes.c_double(), ctypes.c_int()
    status = run(
        solver.pointer,
        ctypes.addressof(options),
        *(array.ctypes.data for array in (basis, space, z, theta)),
        ctypes.addressof(objective),
        ctypes.addressof(iterations),
    )
    return _STOPPED[status], objective.value, iterations.value


@dataclass(frozen=True)
class _Point:
    z: np.ndarray
    theta: np.ndarray
    residual: np.ndarray
    objective: float
    gradient: np.ndarray
    violation: float  # |G|_1
    infeasibility: float  # max |G|


@dataclass(frozen=True)
class _Direction:
    dz: np.ndarray
    dtheta: np.ndarray


class _InteriorPoint:
    """State of one run."""

    def __init__(
        self,
        game: Game,
        solver: Elimination,
        options: _Options,
        known_objectives: np.ndarray,
        known_theta: np.ndarray,
    ) -> None:
        self.solver, self.options = solver, options
        self.floor, self.tie = options.floor, options.tie
        self.known_objectives, self.known_theta = known_objectives, known_theta
        self.uniform = 1 / game.num_weights
        self.nx, nu = solver.stages.num_states, solver.stages.num_controls
        self.moving = np.arange(solver.stages.size) < self.nx + nu  # states and controls
        self.tangent = _tangent(self.nx, game.num_players, game.num_weights)
        self.barrier = options.first_barrier
        self.shift = self.last_shift = 0.0
        self.filter: list[tuple[float, float]] = []

    # ---- the outer loop ---------------------------------------------------------------------

    def run(self, z: np.ndarray, theta: np.ndarray) -> tuple[str, int]:
        """Iterate; why it stopped (empty: converged) and the number of iterations."""
        self.deadline = time.monotonic() + self.options.limit
        self.point = self._evaluate(z, theta)
        self.multipliers = np.zeros_like(z)
        self.duals = np.ones_like(theta)  # of the bounds
        if not np.isfinite(self.point.violation + self.point.objective):
            return "the start is not finite", 0
        self.first_violation = max(1.0, self.point.violation)
        for iteration in range(self.options.max_iterations):
            if self._is_known():
                return CLOSE_TO_KNOWN, iteration
            if not self.solver.linearise(self.point.z, self.point.theta):
                return "singular stage of the first-order conditions", iteration
            self.solver.sensitivities()
            self.reduced_gradient = self.solver.reduce(self.point.gradient)
            self.reduced_gradient[self.nx :] += self._tie_gradient()
            stationarity = self._stationarity()
            if max(stationarity, self._complementarity(0.0)) <= self.options.tolerance:
                return "", iteration
            self._lower_barrier(stationarity)
            if time.monotonic() > self.deadline:
                return "time limit reached", iteration
            if not self._factorise():
                return "the Hessian could not be corrected", iteration
            direction = self._direction(self.point.residual)
            if self._is_rounding(direction):
                self._take(self._trial(direction, 1.0), direction, 1.0)
                self._reduce_barrier()
            elif not (self._line_search(direction) or self._restore()):
                if max(stationarity, self._complementarity(0.0)) <= _ACCEPTABLE:
                    return "", iteration
                return "line search and restoration failed", iteration
        return "iteration limit reached", self.options.max_iterations

    def _is_known(self) -> bool:
        """Whether the point is so close to a known optimum that it can but end there."""
        if not len(self.known_objectives) or self.point.violation > 1e-4 * self.first_violation:
            return False
        change = np.abs(self.point.theta - self.known_theta).max(axis=1)
        difference = np.abs(self.point.objective - self.known_objectives)
        same = (change <= _KNOWN_WEIGHTS) & (difference <= _KNOWN_CHANGE * self.known_objectives)
        return bool(same.any())

    def _evaluate(self, z: np.ndarray, theta: np.ndarray) -> _Point:
        residual = self.solver.evaluate(z, theta)
        loss, gradient = self.solver.observation_loss(z)
        size = np.abs(residual)
        return _Point(
            z=z,
            theta=theta,
            residual=residual,
            objective=loss + self.tie * float(np.sum((theta - self.uniform) ** 2)),
            gradient=gradient,
            violation=float(size.sum()),
            infeasibility=float(size.max()),
        )

    def _tie_gradient(self) -> np.ndarray:
        return 2 * self.tie * (self.point.theta - self.uniform)

    def _stationarity(self) -> float:
        """The parts of E_mu (5) that do not depend on mu.

        The dual part is the gradient along G = 0, which the multipliers of G do not enter.
        """
        gradient = self.reduced_gradient.copy()
        gradient[self.nx :] -= self.duals
        along = np.abs(self.tangent.T @ gradient).max(initial=0.0)
        return max(self.point.infeasibility, float(along) / self._dual_scale())

    def _complementarity(self, barrier: float) -> float:
        products = (self.point.theta - self.floor) * self.duals
        return float(np.abs(products - barrier).max()) / self._dual_scale()

    def _dual_scale(self) -> float:
        """s_d and s_c of (6)."""
        return max(1.0, float(self.duals.sum()) / (100 * len(self.duals)))

    def _lower_barrier(self, stationarity: float) -> None:
        """(7), as often as the present point allows."""
        while self.barrier > self.options.tolerance / 10 and max(
            stationarity, self._complementarity(self.barrier)
        ) <= (_BARRIER_ACCURACY * self.barrier):
            self._reduce_barrier()

    def _reduce_barrier(self) -> None:
        linear, power = _BARRIER_FACTORS
        lowest = self.options.tolerance / 10
        self.barrier = max(lowest, min(linear * self.barrier, self.barrier**power))
        self.filter.clear()

    def _is_rounding(self, direction: _Direction) -> bool:
        """Whether a step would change nothing that floating point can tell."""
        change = np.abs(direction.dz) / (1 + np.abs(self.point.z))
        return max(change.max(), np.abs(direction.dtheta).max()) < 10 * np.finfo(float).eps

    # ---- the linear system ------------------------------------------------------------------

    def _factorise(self) -> bool:
        """Cholesky factor of the tangent Hessian, shifted until it is positive definite (IC)."""
        point = self.point
        hessian = self.solver.reduced_hessian(point.z, point.theta, self.multipliers)
        diagonal = np.arange(self.nx, len(hessian))
        hessian[diagonal, diagonal] += self.duals / (point.theta - self.floor) + 2 * self.tie
        tangent_hessian = self.tangent.T @ hessian @ self.tangent
        self.factor, failed = dpotrf(tangent_hessian, lower=1)
        self.shift = 0.0
        if not np.isfinite(tangent_hessian).all():
            return False
        if failed:
            metric = self.solver.trajectory_metric()
            metric[diagonal, diagonal] += 1.0
            metric = self.tangent.T @ metric @ self.tangent
            first = self.last_shift == 0
            self.shift = _FIRST_SHIFT if first else max(_SMALLEST_SHIFT, self.last_shift / 3)
            while failed:
                self.factor, failed = dpotrf(tangent_hessian + self.shift * metric, lower=1)
                if failed:
                    self.shift *= 100 if first else 8
                if self.shift > _LARGEST_SHIFT:
                    return False
            self.last_shift = self.shift
        return True

    def _direction(self, residual: np.ndarray) -> _Direction:
        """The Newton step (11) for a right-hand side of G; sets nothing."""
        point, solver = self.point, self.solver
        normal = -solver.solve(residual)
        curvature, curvature_theta = solver.hessian_product(normal, np.zeros_like(point.theta))
        if self.shift:
            curvature += self.shift * self.moving * normal
        gradient = self.reduced_gradient + solver.reduce(curvature)
        gradient[self.nx :] += curvature_theta - self.barrier / (point.theta - self.floor)
        reduced, _ = dpotrs(self.factor, -self.tangent.T @ gradient, lower=1)
        d = self.tangent @ reduced
        return _Direction(normal + solver.expand(d), d[self.nx :])

    def _next_multipliers(self, direction: _Direction) -> np.ndarray:
        """Multipliers of G at the full step: the rows of z in (11)."""
        curvature, _ = self.solver.hessian_product(direction.dz, direction.dtheta)
        if self.shift:
            curvature += self.shift * self.moving * direction.dz
        return self.solver.solve(-(self.point.gradient + curvature), transposed=True)

    # ---- globalisation ------------------------------------------------------------------------

    def _line_search(self, direction: _Direction) -> bool:
        """Algorithm A, steps A-4 and A-5; moves the point where a step is accepted."""
        point, boundary = self.point, max(0.99, 1 - self.barrier)
        gap = point.theta - self.floor
        slope = float(np.vdot(point.gradient, direction.dz))
        slope += float((self._tie_gradient() - self.barrier / gap) @ direction.dtheta)
        longest = _longest_step(gap, direction.dtheta, boundary)
        length = longest
        while length >= self._shortest_step(slope, longest):
            trial = self._trial(direction, length)
            if self._acceptable(trial, slope, length):
                self._accept(trial, direction, slope, length, length)
                return True
            if length == longest and trial.violation >= point.violation:
                corrected = self._correct(direction, trial, slope, length, boundary)
                if corrected is not None:
                    trial, used = corrected
                    self._accept(trial, direction, slope, length, used)
                    return True
            length /= 2
        return False

    def _correct(
        self,
        direction: _Direction,
        trial: _Point,
        slope: float,
        length: float,
        boundary: float,
    ) -> tuple[_Point, float] | None:
        """Second-order corrections (A-5.5 to A-5.9)."""
        point = self.point
        residual = length * point.residual + trial.residual
        violation = trial.violation
        for _ in range(_MAX_CORRECTIONS):
            if not np.isfinite(residual).all():
                return None
            correction = self._direction(residual)
            step = _longest_step(point.theta - self.floor, correction.dtheta, boundary)
            trial = self._trial(correction, step)
            if self._acceptable(trial, slope, length):
                return trial, step
            if not trial.violation <= 0.99 * violation:
                return None
            residual = step * residual + trial.residual
            violation = trial.violation
        return None

    def _barrier_objective(self, point: _Point) -> float:
        return point.objective - self.barrier * float(np.log(point.theta - self.floor).sum())

    def _acceptable(self, trial: _Point, slope: float, length: float) -> bool:
        """To the filter, and either of sufficient decrease (20) or of progress (18)."""
        now, then = self._barrier_objective(self.point), self._barrier_objective(trial)
        if not np.isfinite(then + trial.violation):
            return False
        if trial.violation > 1e4 * self.first_violation:
            return False
        if any(trial.violation >= v and then >= b for v, b in self.filter):
            return False
        rounding = 10 * np.finfo(float).eps * abs(now)
        if self._decreases(slope, length):
            return bool(then <= now + 1e-8 * length * slope + rounding)
        enough = (1 - 1e-5) * self.point.violation
        return bool(
            trial.violation <= enough or then <= now - 1e-8 * self.point.violation + rounding
        )

    def _decreases(self, slope: float, length: float) -> bool:
        """The switching condition (19), where the point is almost feasible."""
        small = self.point.violation <= 1e-4 * self.first_violation
        return small and slope < 0 and length * (-slope) ** 2.3 > self.point.violation**1.1

    def _shortest_step(self, slope: float, longest: float) -> float:
        """(23)."""
        violation = self.point.violation
        shortest = 1e-5
        if slope < 0:
            shortest = min(shortest, 1e-8 * violation / -slope)
            if violation <= 1e-4 * self.first_violation:
                shortest = min(shortest, violation**1.1 / (-slope) ** 2.3)
        return max(0.05 * shortest, 1e-12 * longest)

    def _accept(
        self, trial: _Point, direction: _Direction, slope: float, length: float, used: float
    ) -> None:
        point = self.point
        if not (
            self._decreases(slope, length)
            and self._barrier_objective(trial)
            <= self._barrier_objective(point) + 1e-8 * length * slope
        ):
            self._block(point)
        self._take(trial, direction, used)

    def _trial(self, direction: _Direction, length: float) -> _Point:
        point = self.point
        return self._evaluate(
            point.z + length * direction.dz, point.theta + length * direction.dtheta
        )

    def _take(self, trial: _Point, direction: _Direction, length: float) -> None:
        """Move to a trial point, with the multipliers that belong to its direction (14)."""
        gap = self.point.theta - self.floor
        dual_step = self.barrier / gap - self.duals - self.duals / gap * direction.dtheta
        boundary = max(0.99, 1 - self.barrier)
        self.duals = self.duals + _longest_step(self.duals, dual_step, boundary) * dual_step
        self.multipliers += length * (self._next_multipliers(direction) - self.multipliers)
        self._move(trial)

    def _block(self, point: _Point) -> None:
        """Add a point to the filter (22)."""
        objective = self._barrier_objective(point) - 1e-8 * point.violation
        self.filter.append(((1 - 1e-5) * point.violation, objective))

    def _move(self, trial: _Point) -> None:
        """Take a point, with the bounds' duals kept near the central path (16)."""
        self.point = trial
        central = self.barrier / (trial.theta - self.floor)
        self.duals = np.clip(self.duals, central / _MULTIPLIER_RANGE, central * _MULTIPLIER_RANGE)

    def _restore(self) -> bool:
        """Newton on G = 0 at fixed x_1 and weights, in place of IPOPT's restoration phase."""
        point = self.point
        if point.infeasibility <= _FEASIBLE:
            return False
        self._block(point)
        z = point.z[None].copy()
        self.solver.newton(
            z,
            point.theta[None],
            tolerance=_FEASIBLE / 100,
            max_iterations=30,
            limit=max(0.0, self.deadline - time.monotonic()),
        )
        trial = self._evaluate(z[0], point.theta)
        if not trial.violation <= 0.9 * point.violation:
            return False
        self.multipliers = np.zeros_like(point.z)
        self._move(trial)
        return True


@lru_cache(maxsize=32)
def _tangent(num_states: int, players: int, weights: int) -> np.ndarray:
    """Orthonormal basis of the changes (dx_1, dtheta) that keep every player's sum of weights."""
    return block_diag(np.eye(num_states), *[_sum_free(weights)] * players)


@lru_cache(maxsize=32)
def _sum_free(weights: int) -> np.ndarray:
    """Orthonormal basis (K, K-1) of the changes of one player's weights that keep their sum."""
    return np.ascontiguousarray(null_space(np.ones((1, weights))))


def _longest_step(gap: np.ndarray, change: np.ndarray, boundary: float) -> float:
    """Largest step in (0, 1] that leaves a share 1 - boundary of every gap (15)."""
    ratio = float((-change / gap).max(initial=0.0))
    return 1.0 if ratio <= boundary else boundary / ratio
