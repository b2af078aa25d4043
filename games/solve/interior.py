"""A primal-dual interior point method for games with hard constraints.

A variational equilibrium solves the first-order conditions G of ``games.solve.kkt`` with the
constraints' multipliers v, those of a shared constraint common to all players, and slacks s:

    (I1)  G(z) - J' v = 0,    g(z) - s = 0,    s v = tau -> 0,    s > 0,  v > 0.

Newton's step (dz, ds, dv) follows from one sweep in time, as the last two rows can be eliminated
stage by stage:

    (I2)  (G_z - v' g'' + J' diag(v / s) J) dz = -G + J' (tau / s - v (g - s) / s),
          ds = J dz + g - s,    dv = tau / s - v - v ds / s.

With slacks above the margins, the constraints start relaxed: the iteration is also a continuation
from independent players, in which the players' radii grow from zero.

A filter decides how far to step (Waechter, Biegler 2006): a point has to be better than all before
it in the violation of the equations or in

    (I3)  phi = sum_i J^i - tau sum log s,

where the cost of player i is taken along its own new motion and the others' present one. Where
costs look at their own player only, this is the potential of the game. If a stage matrix is not
positive definite, the diagonal of the second derivatives is shifted, so that steps do not lead to
saddles.
"""

from dataclasses import dataclass

import numpy as np

from olne_bench.games.compiled.complementarity import RELAXATION
from olne_bench.games.compiled.elimination import Elimination
from olne_bench.games.compiled.native import NativeElimination

#: The barrier's last weight tau; complementarity s v of every margin ends there.
LAST_TAU = RELAXATION
#: Equations hold to this.
TOLERANCE = 1e-9
#: Steps at most.
MOST_ITERATIONS = 150

_TAU_FACTOR, _TAU_POWER = 0.1, 1.3  # how fast tau falls
_SOLVED_FOR_TAU = 20.0  # tau falls once all errors are below so many of it
_TO_BOUNDARY = 0.99  # share of the way to s = 0 or v = 0
_SHORTEST_STEP = 1e-6
_FIRST_SHIFT, _LARGEST_SHIFT = 1e-3, 1e8
_DUAL_RANGE = 1e10  # v stays within this factor of tau / s
_ROUNDING = 1e-13  # of phi, relative to 1 + |phi|

#: As ``InteriorOptions`` of ``interior.c``.
_OPTIONS = (
    *(LAST_TAU, TOLERANCE, _TAU_FACTOR, _TAU_POWER, _SOLVED_FOR_TAU, _TO_BOUNDARY),
    *(_SHORTEST_STEP, _FIRST_SHIFT, _LARGEST_SHIFT, _DUAL_RANGE, _ROUNDING),
)


@dataclass(frozen=True)
class InteriorSolution:
    """Where the iteration ended.

    Attributes:
        z: (T, size) rows (x_t, u_t, lambda_t).
        multipliers: (T, C) v, zero where a margin is not enforced.
        residual: largest error of G - J' v and g - s.
        solved: whether all equations of (I1) hold.
        iterations: number of steps.
    """

    z: np.ndarray
    multipliers: np.ndarray
    residual: float
    solved: bool
    iterations: int


def solve_interior(
    solver: Elimination,
    theta: np.ndarray,
    z: np.ndarray,
    *,
    coupled: bool,
    tau: float,
    relaxed: float,
    max_iterations: int = MOST_ITERATIONS,
) -> InteriorSolution:
    """Iterate from a trajectory, in native code where there is any.

    Args:
        solver: the game's elimination.
        theta: (N*K,) weights.
        z: (T, size) start; x_1 stays.
        coupled: whether some player's cost looks at other players.
        tau: the barrier's first weight, in units of cost.
        relaxed: smallest first slack, as a share of the mean size of the margin along z.
        max_iterations: number of steps at most.
    """
    if isinstance(solver, NativeElimination):
        found = solver.interior(
            _OPTIONS,
            z,
            theta,
            coupled=coupled,
            tau=tau,
            relaxed=relaxed,
            max_iterations=max_iterations,
        )
        return InteriorSolution(
            found.z, found.multipliers, found.residual, found.solved, found.iterations
        )
    iteration = InteriorPoint(solver, theta, coupled=coupled)
    return iteration.solve(z, tau=tau, relaxed=relaxed, max_iterations=max_iterations)


@dataclass
class _Point:
    """z, slacks s and multipliers v (T, C), and what has been calculated there."""

    z: np.ndarray
    s: np.ndarray
    v: np.ndarray
    gradient: np.ndarray  # G - J' v without the equations of motion (T, size)
    motion: np.ndarray  # the equations' errors x_{t+1} - f
    gap: np.ndarray  # g - s

    @property
    def violation(self) -> float:
        """The violation of the equations."""
        return float(np.abs(self.motion).sum() + np.abs(self.gap).sum())

    @property
    def residual(self) -> float:
        """The largest error of G - J' v and g - s."""
        return float(max(np.abs(part).max() for part in (self.gradient, self.motion, self.gap)))


class InteriorPoint:
    """The iteration for one game, in NumPy; ``interior.c`` is the same algorithm, compiled.

    Args:
        solver: the game's elimination.
        theta: (N*K,) weights.
        coupled: whether some player's cost looks at other players.
    """

    def __init__(self, solver: Elimination, theta: np.ndarray, *, coupled: bool) -> None:
        self.solver, self.theta, self.coupled = solver, theta, coupled
        self.on = solver.enforced
        states, controls = solver.stages.num_states, solver.stages.num_controls
        self._states, self._costates = slice(0, states), slice(states + controls, None)

    def solve(
        self, z: np.ndarray, *, tau: float, relaxed: float, max_iterations: int
    ) -> InteriorSolution:
        """Iterate from a trajectory (T, size); for the arguments see ``solve_interior``."""
        margins = self._margins(z)
        size = np.abs(margins).sum(0, where=self.on) / np.maximum(self.on.sum(0), 1)
        s = np.where(self.on, np.maximum(margins, relaxed * size + 1e-8), 1.0)
        point = self._at(z, s, np.where(self.on, tau / s, 0.0))
        limits = 1e4 * max(1.0, point.violation), 1e-4 * max(1.0, point.violation)
        filter_: list[tuple[float, float]] = []
        self._shift, iterations = 0.0, 0
        while not self._solved(point, LAST_TAU, 1.0) and iterations < max_iterations:
            while tau > LAST_TAU and self._solved(point, tau, _SOLVED_FOR_TAU):
                tau = max(LAST_TAU, min(_TAU_FACTOR * tau, 1e-3 * (1e3 * tau) ** _TAU_POWER))
                filter_ = []
            following = self._step(point, tau, filter_, limits)
            if following is None:
                break
            point, iterations = following, iterations + 1
        solved = self._solved(point, LAST_TAU, 1.0)
        return InteriorSolution(point.z, point.v, point.residual, solved, iterations)

    def _step(
        self,
        point: _Point,
        tau: float,
        filter_: list[tuple[float, float]],
        limits: tuple[float, float],
    ) -> _Point | None:
        """One step, (I2); None where no shift makes the stage matrices definite."""
        direction = self._direction(point, tau)
        if direction is None:
            return None
        dz, ds, dv = direction
        primal, dual = self._to_boundary(point.s, ds), self._to_boundary(point.v, dv)
        slope = self._slope(point, dz, ds, tau)
        phi = self._phi(point.z, point.z, point.s, tau)
        if self.coupled:  # phi of other steps means something else
            filter_.clear()
        length, violation = primal, point.violation
        while length > _SHORTEST_STEP:
            z, s = point.z + length * dz, point.s + length * ds
            trial = self._at(z, s, point.v + dual * dv)
            found = trial.violation, self._phi(point.z, z, s, tau) - _ROUNDING * (1 + abs(phi))
            if np.isfinite(found).all() and _acceptable(found, filter_, limits[0]):
                descends = slope < 0 and length * (-slope) ** 2.3 > violation**1.1
                if violation <= limits[1] and descends:
                    if found[1] <= phi + 1e-4 * length * slope:
                        return self._kept(trial, tau)
                elif found[0] <= (1 - 1e-5) * violation or found[1] <= phi - 1e-5 * violation:
                    filter_.append((violation, phi))
                    return self._kept(trial, tau)
            length /= 2
        filter_.clear()  # a step that the filter does not like is better than none
        trial = self._at(point.z + primal * dz, point.s + primal * ds, point.v + dual * dv)
        return self._kept(trial, tau)

    def _direction(
        self, point: _Point, tau: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """(dz, ds, dv) of (I2); None where no shift makes the stage matrices definite."""
        sigma, shift = np.where(self.on, point.v / point.s, 0.0), 0.0
        while not self.solver.linearise_condensed(point.z, self.theta, point.v, sigma, shift):
            if shift == 0.0:
                shift = max(1e-6, self._shift / 3) if self._shift else _FIRST_SHIFT
            else:
                shift *= 8.0 if self._shift else 100.0
            if shift > _LARGEST_SHIFT:
                return None
        self._shift = shift or self._shift
        centred = np.where(self.on, tau / point.s, 0.0)
        right = point.gradient + point.motion
        right -= self._pushed(point.z, centred - sigma * point.gap - point.v)
        dz = -self.solver.solve(right)
        ds = np.where(self.on, self.solver.change(point.z, dz), 0.0) + point.gap
        return dz, ds, centred - point.v - sigma * ds

    def _at(self, z: np.ndarray, s: np.ndarray, v: np.ndarray) -> _Point:
        gradient = self.solver.evaluate(z, self.theta) - self._pushed(z, v)
        motion = np.zeros_like(z)
        motion[:, self._costates] = gradient[:, self._costates]
        gap = np.where(self.on, self._margins(z) - s, 0.0)
        return _Point(z, s, v, gradient - motion, motion, gap)

    def _kept(self, point: _Point, tau: float) -> _Point:
        """The point, with multipliers not too far from tau / s."""
        centred = np.where(self.on, tau / point.s, 0.0)
        v = np.clip(point.v, centred / _DUAL_RANGE, centred * _DUAL_RANGE)
        return self._at(point.z, point.s, v) if (v != point.v).any() else point

    def _margins(self, z: np.ndarray) -> np.ndarray:
        return np.where(self.on, self.solver.margins(z), 1.0)

    def _pushed(self, z: np.ndarray, v: np.ndarray) -> np.ndarray:
        """J' v, without what would push x_1."""
        pushed = self.solver.push(z, v)
        pushed[0, self._states] = 0.0
        return pushed

    def _phi(self, present: np.ndarray, z: np.ndarray, s: np.ndarray, tau: float) -> float:
        """(I3) at z, where the present motion is another one."""
        barrier = -tau * float(np.log(s).sum(where=self.on))
        if not self.coupled:
            return float(self.solver.costs(z, self.theta).sum()) + barrier
        count = self.solver.stages.num_players
        inputs = self._costates.start // count
        states = self._states.stop // count
        total = barrier
        for i in range(count):
            mixed = present.copy()
            controls = slice(
                self._states.stop + i * (inputs - states),
                self._states.stop + (i + 1) * (inputs - states),
            )
            for own in (slice(i * states, (i + 1) * states), controls):
                mixed[:, own] = z[:, own]
            total += float(self.solver.costs(mixed, self.theta)[i])
        return total

    def _slope(self, point: _Point, dz: np.ndarray, ds: np.ndarray, tau: float) -> float:
        """The derivative of phi along Newton's direction.

        The gradient of the costs is that of the Lagrangian less those of motion and constraints,
        which change by -motion and by ds - gap.
        """
        uphill = float((point.gradient * dz).sum() + (point.motion * point.z).sum())
        uphill += float((point.v * (ds - point.gap)).sum())
        return uphill - tau * float((ds / point.s).sum(where=self.on))

    def _to_boundary(self, value: np.ndarray, change: np.ndarray) -> float:
        """The longest step, at most 1, along which a positive value stays positive."""
        falling = self.on & (change < 0)
        ratios = -value[falling] / change[falling]
        return min(1.0, _TO_BOUNDARY * float(ratios.min(initial=np.inf)))

    def _solved(self, point: _Point, tau: float, times: float) -> bool:
        """Whether the equations hold for tau, to so many times of it."""
        products = np.abs(np.where(self.on, point.s * point.v - tau, 0.0)).max(initial=0.0)
        limit = TOLERANCE if tau == LAST_TAU else times * tau
        return bool(point.residual < limit and products < max(limit, times * tau))


def _acceptable(
    found: tuple[float, float], filter_: list[tuple[float, float]], limit: float
) -> bool:
    """Whether a violation and phi are better than each of the filter in one of the two."""
    return found[0] <= limit and all(
        found[0] < (1 - 1e-5) * violation or found[1] < phi - 1e-5 * violation
        for violation, phi in filter_
    )
