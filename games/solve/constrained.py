"""Forward games with hard constraints: variational equilibria, and their certificates.

The interior point method of ``games.solve.interior`` starts from independent players, with a low
barrier that keeps the side on which their own plans would pass. Where two plans nearly coincide, it
starts twice, with either player ahead, and the solution of the lower total cost counts. If none is
found, starts with a higher weight follow, at which players look for room first, and at last other
plans: the root of the game without constraints, and coasting.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import islice

import casadi as ca
import numpy as np

from olne_bench.games.compiled.constraint_functions import kind_of
from olne_bench.games.compiled.elimination import Elimination, elimination, interior_elimination
from olne_bench.games.model.constraints import Constraint, constraint_stage, described
from olne_bench.games.model.dynamics import Dynamics, numeric_step, rollout
from olne_bench.games.model.equilibrium import VIOLATION_TOLERANCE, Certificate, Equilibrium, Gains
from olne_bench.games.model.game import Game
from olne_bench.games.model.numbers import numbers_of, skeleton, with_symbols
from olne_bench.games.solve.constrained_response import constrained_response
from olne_bench.games.solve.continuation import coupled_features, follow_coupling
from olne_bench.games.solve.interior import (
    MOST_ITERATIONS,
    TOLERANCE,
    InteriorSolution,
    solve_interior,
)
from olne_bench.games.solve.newton import Root, pack, rows, unpack


@dataclass(frozen=True)
class _Attempt:
    """How the interior point method starts."""

    barrier: float  # its first weight, all margins together, relative to the players' cost
    relaxed: float  # smallest first slack, relative to the mean size of a margin


#: The first one is used wherever it works.
_ATTEMPTS = (_Attempt(0.2, 0.5), _Attempt(20.0, 1.0), _Attempt(2.0, 0.2))

#: Newton's method on a solution of the interior point method: tolerance and steps.
_TIGHT, _FEW = 1e-12, 10

#: From a motion close to the solution.
_NEAR = _Attempt(0.002, 0.05)

#: Plans nearly coincide where a margin is beyond this share of its value at one position.
_COINCIDE = 0.95

#: A player is put ahead until the margin is this share of its value at one position: circles then
#: overlap by half.
_APART = 0.75


def solve_constrained(
    game: Game,
    weights: np.ndarray,
    initial_state: np.ndarray,
    controls: np.ndarray,
    *,
    tolerance: float,
) -> Equilibrium:
    """Find a variational equilibrium, as ``solve_olne``; ValueError if the start is infeasible."""
    solution = variational_solution(game, weights, initial_state, controls)
    root, multipliers = as_root(game, solution, weights)
    solver = interior_elimination(game)
    z = rows(game, root.states, root.controls, root.costates)
    margins = np.where(solver.enforced, solver.margins(z), np.inf)
    return Equilibrium(
        states=root.states,
        controls=root.controls,
        costates=root.costates,
        residual=root.residual,
        certificate=certify_constrained(game, root, weights, tolerance=tolerance),
        multipliers=multipliers,
        margins=margins,
    )


def as_root(
    game: Game, solution: InteriorSolution, weights: np.ndarray, solver: Elimination | None = None
) -> tuple[Root, np.ndarray]:
    """A solution of the interior point method as a root, and its multipliers (T, C).

    Weights are (N, K), or (N, K + U) where the game has unknowns. The residual is that of the
    interior point method if Newton's method does not reach a root
    (``games.compiled.complementarity``).
    """
    solver = solver or elimination(game)
    states, controls, costates = unpack(game, solution.z)
    interior = interior_elimination(game, game.with_known_constraints(weights)[0])
    pushed = interior.push(solution.z, solution.multipliers)
    costates -= pushed[1:, : costates[0].size].reshape(costates.shape)
    points = pack(game, states, controls, costates, weights, solver)[None]
    theta = np.asarray(weights, dtype=float).reshape(1, -1)
    residuals, _ = solver.newton(points, theta, tolerance=_TIGHT, max_iterations=_FEW, limit=np.inf)
    if solution.solved and residuals[0] < TOLERANCE:
        root = Root(*unpack(game, points[0]), residual=float(residuals[0]))
        return root, _multipliers(game, interior, points[0])
    residual = solution.residual if solution.solved else np.inf
    return Root(states, controls, costates, residual), solution.multipliers


def _multipliers(game: Game, solver: Elimination, z: np.ndarray) -> np.ndarray:
    """Multipliers (T, C) of all margins in rows (T, size) of ``games.compiled.complementarity``."""
    stages = elimination(game).stages
    first = stages.num_states + stages.num_players * stages.own_controls
    found = np.zeros(solver.enforced.shape)
    for place, equation in zip(solver.stages.constraints, stages.complementarities, strict=True):
        after = stages.complementarity_kinds[equation.kind].after
        for k, is_after in enumerate(after):
            own = z[:-1, first + equation.offset + k]
            if is_after:  # in the last step, such margins are the only ones
                found[1:-1, place.offset + k] = own[:-1]
                found[-1, place.offset + sum(after[:k])] = own[-1]
            else:
                found[:-1, place.offset + k] = own
    return np.where(solver.enforced, found, 0.0)


def variational_solution(
    game: Game,
    weights: np.ndarray,
    initial_state: np.ndarray,
    controls: np.ndarray,
    *,
    most_attempts: int | None = None,
) -> InteriorSolution:
    """The best solution of the first-order conditions from all attempts, without a certificate.

    Weights (N, K), or (N, K + U) where the game has unknowns. ``most_attempts`` bounds the time
    that a game without a solution takes; None for all of them. Raises ValueError as
    ``solve_constrained`` does.
    """
    asked, (game, weights) = game, game.with_known_constraints(weights)
    check_start(game, initial_state)
    solver, theta = interior_elimination(asked, game), np.ravel(weights)
    plans = _independent_players(game, solver, weights, initial_state, controls)

    def attempts() -> Iterator[tuple[_Attempt, list[np.ndarray]]]:
        starts = _starts(game, solver, plans)
        yield from ((attempt, starts) for attempt in _ATTEMPTS)
        starts = _further_starts(game, weights, initial_state, controls)
        yield from ((attempt, starts) for attempt in _ATTEMPTS)

    for attempt, starts in islice(attempts(), most_attempts):
        solutions = [_attempted(game, solver, theta, start, attempt) for start in starts]
        solved = [solution for solution in solutions if solution.solved]
        if solved:
            return min(solved, key=lambda one: float(solver.costs(one.z, theta).sum()))
    return solutions[0]


def _further_starts(
    game: Game, weights: np.ndarray, initial_state: np.ndarray, controls: np.ndarray
) -> list[np.ndarray]:
    """The root of the game without constraints, and the controls as they are."""
    free = replace(game, constraints=())
    root = follow_coupling(free, weights, initial_state, controls, max_factorisations=200)
    states = rollout(game.dynamics, initial_state, controls, game.dt)
    starts = [rows(game, states, controls, np.zeros_like(states[1:]))]
    if root is not None and np.isfinite(root.residual):
        starts.insert(0, rows(game, root.states, root.controls, root.costates))
    return starts


def root_near(
    game: Game,
    near: Root,
    weights: np.ndarray,
    *,
    max_iterations: int = MOST_ITERATIONS,
    solver: Elimination | None = None,
) -> Root:
    """The root to which the interior point method leads from a known motion; x_1 is its first row.

    The residual is infinite if there is none, or if the start breaks a constraint; ``solver`` is
    that of ``as_root``.
    """
    lost = replace(near, residual=np.inf)
    known, theta = game.with_known_constraints(weights)
    try:
        check_start(known, near.states[0])
    except ValueError:
        return lost
    solution = _near(game, interior_elimination(game, known), near, theta, max_iterations)
    return as_root(game, solution, weights, solver)[0] if solution.solved else lost


def solution_near(
    game: Game, near: Root, weights: np.ndarray, *, max_iterations: int
) -> InteriorSolution:
    """What the interior point method finds from a motion close to a solution; x_1 is its first row.

    It is cheaper than ``root_near``, as nothing is polished. Weights (N, K). Raises ValueError if
    the start breaks a constraint and no control can change that.
    """
    check_start(game, near.states[0])
    return _near(game, interior_elimination(game), near, weights, max_iterations)


def _near(
    game: Game, solver: Elimination, near: Root, theta: np.ndarray, max_iterations: int
) -> InteriorSolution:
    start = rows(game, near.states, near.controls, near.costates)
    return _attempted(game, solver, np.ravel(theta), start, _NEAR, max_iterations)


def _attempted(
    game: Game,
    solver: Elimination,
    theta: np.ndarray,
    start: np.ndarray,
    attempt: _Attempt,
    max_iterations: int = MOST_ITERATIONS,
) -> InteriorSolution:
    cost = float(np.abs(solver.costs(start, theta)).sum()) + 1e-6
    return solve_interior(
        solver,
        theta,
        start,
        coupled=bool(coupled_features(game).any()),
        tau=attempt.barrier * cost / max(1, int(solver.enforced.sum())),
        relaxed=attempt.relaxed,
        max_iterations=max_iterations,
    )


def _starts(game: Game, solver: Elimination, plans: np.ndarray) -> list[np.ndarray]:
    """The plans (T, size); if two nearly coincide at a margin, each of the two ahead once."""
    n, shared = game.dynamics.state_size, {}
    for place, constraint in zip(solver.stages.constraints, game.constraints, strict=True):
        if len(constraint.players) == 2:
            for k in range(solver.stages.constraint_kinds[place.kind][0].num_margins):
                shared[place.offset + k] = constraint.players
    columns = list(shared)
    together = plans.copy()
    for i in range(game.num_players):
        together[:, i * n : i * n + 2] = plans[:, :2]
    deepest = np.where(solver.enforced, solver.margins(together), 0.0)[:, columns]
    depth = np.divide(
        solver.margins(plans)[:, columns], deepest, out=np.zeros_like(deepest), where=deepest < 0
    )
    if not depth.max(initial=0.0) > _COINCIDE:
        return [plans]
    step, k = divmod(int(np.argmax(depth)), len(columns))
    one, other = (slice(i * n, i * n + 2) for i in shared[columns[k]])
    way = plans[min(step + 1, len(plans) - 1), one] - plans[step - 1, one]
    length = 1e-3 * float(np.ptp(plans[:, one], axis=0).max())
    ahead = way / max(float(np.linalg.norm(way)), 1e-12)
    starts = []
    for sign in (1.0, -1.0):
        moved, shift = plans.copy(), sign * length * ahead
        while solver.margins(moved)[step, columns[k]] < _APART * deepest[step, k] and shift.any():
            shift = 1.25 * shift
            moved[1:, one], moved[1:, other] = plans[1:, one] + shift, plans[1:, other] - shift
        starts.append(moved)
    return starts


def check_start(game: Game, initial_state: np.ndarray) -> None:
    """Refuse a start that breaks constraints; ValueError names constraint, players and step."""
    still = np.zeros(game.control_shape[1:])
    moved = np.array(numeric_step(game.dynamics, game.dt)(initial_state.T, still.T)).T
    for constraint in game.constraints:
        margins, fixed_after = _start_margins(skeleton(kind_of(constraint)), game.dynamics, game.dt)
        numbers = numbers_of(constraint)
        players = list(constraint.players)
        for step, states, fixed in ((0, initial_state, True), (1, moved, fixed_after)):
            if not fixed or step < constraint.first_step:
                continue
            smallest = float(np.array(margins(states[players].T, numbers)).min(initial=np.inf))
            if smallest < 0:
                when = "after the first step, whatever the control" if step else "at the start"
                raise ValueError(f"{described(constraint)} is broken {when}: {smallest:.3g}")


@lru_cache(maxsize=256)
def _start_margins(
    constraint: Constraint, dynamics: Dynamics, dt: float
) -> tuple[ca.Function, bool]:
    """Margins of states (n, players) and numbers; whether no control changes them after one step.

    The constraint is the skeleton of all that have the same formula.
    """
    stage = constraint_stage(constraint, dynamics, dt, last=True)
    numbers = ca.SX.sym("numbers", len(numbers_of(constraint)))
    margins = ca.SX(with_symbols(constraint, numbers).margins(stage))
    states = ca.horzcat(*stage.states)
    value = ca.Function("margins", [states, numbers], [ca.densify(margins)])
    controls = [ca.SX.sym("u", dynamics.control_size) for _ in stage.states]
    after = [
        dynamics.step(state, control, dt)
        for state, control in zip(stage.states, controls, strict=True)
    ]
    return value, not ca.depends_on(value(ca.horzcat(*after), numbers), ca.vertcat(*controls))


def _independent_players(
    game: Game,
    solver: Elimination,
    weights: np.ndarray,
    initial_state: np.ndarray,
    controls: np.ndarray,
) -> np.ndarray:
    """(T, size) of what the players would do without each other and without constraints."""
    states = rollout(game.dynamics, initial_state, controls, game.dt)
    point = rows(game, states, controls, np.zeros_like(states[1:]))[None]
    alone = np.where(coupled_features(game), 0.0, weights)
    solver.newton(point, alone.reshape(1, -1), tolerance=1e-6, max_iterations=50, limit=60.0)
    start: np.ndarray = point[0]
    return start


def most_broken(game: Game, margins: np.ndarray) -> str | None:
    """The constraint that margins (T, C) break most, described; None if none is broken."""
    if not margins.min(initial=0.0) < 0:
        return None
    column = int(np.argmin(margins.min(axis=0)))
    places = interior_elimination(game).stages.constraints
    index = max(k for k, place in enumerate(places) if place.offset <= column)
    return f"{described(game.constraints[index])} is broken by {-margins.min():.3g}"


def certify_constrained(
    game: Game, root: Root | Equilibrium, weights: np.ndarray, *, tolerance: float
) -> Certificate:
    """Check by constrained best responses that no player gains by deviating alone; weights (N, K).

    A gain up to ``tolerance``, relative to 1 + |J^i|, is allowed.
    """
    solver = interior_elimination(game)
    z = rows(game, root.states, root.controls, root.costates)
    costs = solver.costs(z, np.ravel(weights))
    margins = np.where(solver.enforced, solver.margins(z), 0.0)
    violation = float(max(0.0, -margins.min(initial=0.0)))
    starts = np.full(game.num_players, 2)
    if not (root.residual <= TOLERANCE and np.isfinite(costs).all()):
        unknown = Gains(np.full(game.num_players, np.nan), 0 * starts, passed=False)
        return Certificate(costs, tolerance, unknown, violation=violation)

    states, controls = root.states, root.controls
    rng = np.random.default_rng(0)  # any fixed direction off the symmetry axes will do
    perturbed = controls + 1e-3 * rng.standard_normal(controls.shape)
    gains = np.empty(game.num_players)
    solved = True
    for i in range(game.num_players):
        found = []
        for plan in (controls, perturbed):
            response = constrained_response(game, i, states, controls, plan[:, i], weights[i])
            solved = solved and response.converged
            found.append(response.cost)
        gains[i] = costs[i] - min(found)
    stationary = bool((gains <= tolerance * (1 + np.abs(costs))).all())
    passed = solved and stationary and violation <= VIOLATION_TOLERANCE
    return Certificate(costs, tolerance, Gains(gains, starts, passed), violation=violation)
