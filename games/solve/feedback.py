"""Feedback Nash equilibria: each player has the best strategy u^i_t = gamma^i_t(x_t).

Players of an open-loop game commit to plans; here they see the state at each step and answer it.
Around a motion, the dynamics are linear and costs quadratic in changes dx, du (iterative LQ games;
Fridovich-Keil et al. 2020):

    (F1)  dx_{t+1} = [A B] d,  d = (dx, du);  cost of player i: g^i' d + d' H^i d / 2
    (F2)  V^i_{t+1}(dx) = dx' Z^i dx / 2 + zeta^i' dx;  at the end, Z^i and zeta^i are H^i and g^i
    (F3)  the rows du^i of  W^i d + w^i  vanish, where
          W^i = H^i + zeta^i' f'' + [A B]' Z^i [A B],  w^i = g^i + [A B]' zeta^i
    (F4)  du = -P dx - a solves them for all players at once
    (F5)  Z^i_t = K' W^i K,  zeta^i_t = K' (w^i + W^i k),  K = (I, -P), k = (0, -a)

The next motion is rolled out with the strategies u - P (x' - x) - eta a, with the largest
eta = 1, 1/2, ... that makes a smaller. At a motion with a = 0 no player gains, to first order, by
another strategy while the others keep theirs. The paper leaves out f'', second derivatives of the
motion; with them (Laine et al. 2021) LQ games converge in fewer rounds. Second derivatives of
strategies are left out by both.
"""

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from olne_bench.games.compiled.buffered import BufferedFunction
from olne_bench.games.model.constraints import refuse_constraints
from olne_bench.games.model.game import Game
from olne_bench.games.model.numbers import Structure, structure_and_numbers, with_symbols
from olne_bench.games.model.stage_costs import written_costs
from olne_bench.games.solve.olne import solve_olne

#: Largest |a|, in units of controls, at which a motion counts as an equilibrium.
TOLERANCE = 1e-8

#: Shortest share of a step that is tried.
_LEAST_STEP = 2.0**-12

#: Rounds of one player's response.
_MOST_RESPONSES = 40


@dataclass(frozen=True)
class FeedbackEquilibrium:
    """A motion, and the linear strategies around it.

    Attributes:
        states: (T, N, n).
        controls: (T-1, N, m).
        gains: (T-1, N, m, N*n) P: a change dx of the joint state changes controls by -P dx.
        costs: (N,) J^i of the motion.
        residual: max |a| over all players and steps.
        least_curvature: the smallest eigenvalue of H_uu^i + B_i' Z^i B_i; positive where every
            player's own condition is a minimum.
        iterations: number of LQ games.
    """

    states: np.ndarray
    controls: np.ndarray
    gains: np.ndarray
    costs: np.ndarray
    residual: float
    least_curvature: float
    iterations: int

    @property
    def converged(self) -> bool:
        """Whether (F3) holds, and each player's own part of it is a minimum."""
        return self.residual <= TOLERANCE and self.least_curvature > 0

    def action(self, t: int, states: np.ndarray) -> np.ndarray:
        """Controls (N, m) of the strategies at step t and joint states (N, n)."""
        away = (states - self.states[t]).ravel()
        return np.asarray(self.controls[t] - self.gains[t] @ away)


def solve_feedback(
    game: Game,
    weights: np.ndarray,
    initial_state: np.ndarray,
    *,
    initial_controls: np.ndarray | None = None,
    max_iterations: int = 100,
) -> FeedbackEquilibrium:
    """Find a feedback Nash equilibrium of a game; ``converged`` says whether one was found.

    Weights (N, K) are scaled to row sums of one; x_1 is (N, n), the first motion's controls (T-1,
    N, m), those of the open-loop game if None. Raises ValueError on arguments of a wrong shape, or
    a game with constraints or unknowns.
    """
    refuse_constraints(game.constraints, "a feedback equilibrium")
    if game.parameters.count:
        raise ValueError("a feedback equilibrium needs a game whose numbers are known: game.known")
    theta, start = game.check_weights(weights), game.check_initial_state(initial_state)
    if initial_controls is None:
        initial_controls = solve_olne(game, theta, start).controls
    plan = np.asarray(initial_controls, dtype=float)
    plan = plan.reshape(game.horizon - 1, plan[0].size)
    still = np.tile(start.ravel(), (game.horizon, 1))
    open_loop = np.zeros((*plan.shape, start.size))
    return _LqGame(game, theta).solved(still, plan, open_loop, max_iterations, None)


def certify_feedback(
    game: Game,
    found: FeedbackEquilibrium,
    weights: np.ndarray,
    *,
    starts: int = 4,
    spread: float = 0.2,
    seed: int = 0,
) -> np.ndarray:
    """What each player gains by another strategy nearby, relative to 1 + |J^i| (N,): about zero.

    While the others keep theirs, a player's best linear strategy at weights (N, K) is sought from
    ``starts`` plans next to its own, where each control is off by a normal number of standard
    deviation ``spread``, in the controls' units.
    """
    theta, rng = game.check_weights(weights), np.random.default_rng(seed)
    steps, count, m = game.control_shape
    lq, x = _LqGame(game, theta), found.states.reshape(game.horizon, -1)
    gains, best = found.gains.reshape(steps, count * m, -1), found.costs.copy()
    for player in range(count):
        for _ in range(starts):
            plan = found.controls.copy()
            plan[:, player] += spread * rng.standard_normal((steps, m))
            response = lq.solved(x, plan.reshape(steps, -1), gains, _MOST_RESPONSES, player)
            best[player] = np.fmin(best[player], response.costs[player])
    return np.asarray((found.costs - best) / (1 + np.abs(found.costs)))


@dataclass(frozen=True)
class _Answer:
    """The LQ game around a motion x (T, Nn), u (T-1, Nm): its strategies."""

    x: np.ndarray
    u: np.ndarray
    gains: np.ndarray  # (T-1, Nm, Nn) P
    offsets: np.ndarray  # (T-1, Nm) a
    curvatures: np.ndarray  # (T-1, N, m, m) each player's own second derivative in (F3)
    costs: np.ndarray  # (N,) J^i of the motion

    @property
    def size(self) -> float:
        """Norm of the offsets; infinite where the LQ game has no solution."""
        norm = float(np.linalg.norm(self.offsets))
        return norm if np.isfinite(norm) else np.inf

    @property
    def residual(self) -> float:
        """The largest offset."""
        return float(np.abs(self.offsets).max()) if np.isfinite(self.size) else np.inf


class _LqGame:
    """LQ games around motions of a game at certain weights."""

    def __init__(self, game: Game, theta: np.ndarray) -> None:
        structure, numbers = structure_and_numbers(game)
        self._game, self._known = game, (theta.ravel(), numbers.ravel())
        self._functions = _functions(structure, game.horizon - 1)
        self.count, self.size = game.num_players, game.dynamics.state_size
        self.own = game.dynamics.control_size
        states, controls = self.count * self.size, self.count * self.own
        self._states, self._controls = states, controls
        # Places of each player's controls among (x, u), and of its state and controls.
        self._own = states + np.arange(controls).reshape(self.count, self.own)
        placed = np.hstack([np.arange(states).reshape(self.count, self.size), self._own])
        self._places = placed[:, :, None], placed[:, None, :]

    def solved(
        self, x: np.ndarray, plan: np.ndarray, gains: np.ndarray, most: int, player: int | None
    ) -> FeedbackEquilibrium:
        """Iterated LQ games from strategies plan (T-1, Nm) - gains (T-1, Nm, Nn) (x' - x).

        Where a ``player`` is named, the others keep theirs.
        """
        free = np.zeros(self._controls, dtype=bool)
        free.reshape(self.count, self.own)[range(self.count) if player is None else player] = True
        answer = self._answer(*self._rolled(x, plan, gains, 0 * plan), gains, free)
        iterations = 1
        while answer.residual > TOLERANCE:
            eta = 1.0
            while eta >= _LEAST_STEP and iterations < most:
                iterations += 1
                motion = answer.x, answer.u, answer.gains, eta * answer.offsets
                trial = self._answer(*self._rolled(*motion), gains, free)
                if trial.size < (1 - 0.1 * eta) * answer.size:
                    break
                eta /= 2
            else:
                break
            answer = trial
        return self._described(answer, iterations)

    def _described(self, answer: _Answer, iterations: int) -> FeedbackEquilibrium:
        game, least = self._game, -np.inf
        if np.isfinite(answer.size):
            least = float(np.linalg.eigvalsh(answer.curvatures).min())
        return FeedbackEquilibrium(
            states=answer.x.reshape(game.state_shape),
            controls=answer.u.reshape(game.control_shape),
            gains=answer.gains.reshape(*game.control_shape, self._states),
            costs=answer.costs,
            residual=answer.residual,
            least_curvature=least,
            iterations=iterations,
        )

    def _rolled(
        self, x: np.ndarray, u: np.ndarray, gains: np.ndarray, less: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """The motion of strategies u - gains (x' - x) - less from x_1."""
        flat, dt = gains.reshape(len(u), -1), np.full((len(u), 1), self._game.dt)
        after = np.vstack([x[0], self._functions.roll(x[0], x[:-1], u, flat, less, dt)])
        away = after[:-1] - x[:-1]
        return after, u - (gains @ away[..., None])[..., 0] - less

    def _answer(self, x: np.ndarray, u: np.ndarray, kept: np.ndarray, free: np.ndarray) -> _Answer:
        """(F1) to (F5); controls that are not free (Nm,) keep their gains (T-1, Nm, Nn)."""
        states, controls = self._states, self._controls
        steps, players, fixed = len(u), np.arange(self.count), ~free
        costs, motion, squares, slopes, bends, Z, zeta = self._expanded(x, u)
        gains, offsets = kept.copy(), np.where(free, np.inf, np.zeros((steps, controls)))
        curvatures = np.empty((steps, self.count, self.own, self.own))
        follow, still = np.eye(states + controls, states), np.zeros(states + controls)
        inner = players[:, None, None], np.arange(self.own)[:, None], self._own[:, None, :]
        rows = players[:, None], self._own
        for t in range(steps - 1, -1, -1):
            own = zeta.reshape(self.count, self.count, self.size)
            squares[t][:, *self._places] += np.einsum("ijk,jkab->ijab", own, bends[t])
            whole = squares[t] + motion[t].T @ Z @ motion[t]
            pull = slopes[t] + zeta @ motion[t]
            mine = whole[rows]  # (N, m, Nn + Nm): (F3)
            curvatures[t], flat = mine[inner], mine.reshape(controls, -1)[free]
            of_states, of_controls = flat[:, :states], flat[:, states:]
            if fixed.any():
                of_states = of_states - of_controls[:, fixed] @ kept[t, fixed]
            right = np.column_stack([of_states, pull[rows].ravel()[free]])
            try:
                found = np.linalg.solve(of_controls[:, free], right)
            except np.linalg.LinAlgError:
                offsets[:] = np.inf
                break
            gains[t, free], offsets[t, free] = found[:, :states], found[:, states]
            follow[states:], still[states:] = -gains[t], -offsets[t]
            zeta = (pull + whole @ still) @ follow
            Z = follow.T @ whole @ follow
        return _Answer(x, u, gains, offsets, curvatures, costs)

    def _expanded(self, x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, ...]:
        """(F1): costs, (T-1, ...) [A B], H, g and second derivatives of the motion; Z_T, zeta_T."""
        count, n, own, states = self.count, self.size, self.size + self.own, self._states
        both, steps = states + self._controls, len(u)
        parts = self._functions.steps(x[:-1], u, *self._known)
        shapes = (states, both), (count, both, both), (count, both), (count, n, own, own)
        ends = np.cumsum([count, *map(np.prod, shapes)])
        running, *cut = np.split(parts, ends[:-1], axis=1)
        motion, squares, slopes, bends = (
            part.reshape(steps, *shape) for part, shape in zip(cut, shapes, strict=True)
        )
        last = self._functions.final(x[-1], *self._known)[0]
        final, Z, zeta = np.split(last, [count, count + count * states**2])
        ending = Z.reshape(count, states, states), zeta.reshape(count, states)
        return running.sum(axis=0) + final, motion, squares, slopes, bends, *ending


@dataclass(frozen=True)
class _Functions:
    """Compiled expressions of a game; rows of arguments and results are steps."""

    steps: BufferedFunction  # (x, u, theta, numbers) -> costs, [A B], H, g, f''
    final: BufferedFunction  # (x_T, theta, numbers) -> costs, H, g
    roll: BufferedFunction  # (x_1, x, u, P, less, dt) -> next states


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
    mapped = ca.Function("parts", [x, u, *known], [parts]).map("parts", "serial", steps, [2, 3], [])
    return _Functions(
        steps=BufferedFunction(mapped),
        final=BufferedFunction(ca.Function("final", [x, *known], [last])),
        roll=BufferedFunction(roll.mapaccum(steps)),
    )


def _column(*parts: ca.SX) -> ca.SX:
    return ca.densify(ca.vertcat(*map(ca.vec, map(ca.densify, parts))))
