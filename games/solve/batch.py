"""Many forward games at once: roots of the first-order conditions near a known equilibrium.

Each root is predicted to first order by the implicit function theorem, then refined by Newton's
method; the interior point method solves what is left where a game has hard constraints. Roots are
not certified, but near a certified equilibrium nearly always equilibria as well
(``games.solve.olne.certify``).
"""

import time
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from olne_bench.games.compiled.complementarity import RELAXATION
from olne_bench.games.compiled.elimination import Elimination, elimination
from olne_bench.games.model.game import Game
from olne_bench.games.solve.constrained import root_near
from olne_bench.games.solve.continuation import coupled_features
from olne_bench.games.solve.interior import MOST_ITERATIONS
from olne_bench.games.solve.newton import Root, linearised, pack, unpack
from olne_bench.games.solve.olne import RESIDUAL_TOLERANCE, Equilibrium

#: Factorisations per start: good starts converge within them, bad ones are given up.
_FEW = 6

#: The same with constraints, where the interior point method follows: for costs that look at their
#: own player only; where complementarity is relaxed, so that kinks become bends; and else. More
#: steps across kinks may take players to another side of each other.
_FEW_UNCOUPLED, _FEW_AT_BENDS, _FEW_AT_KINKS = 20, 8, 3

#: Steps of the interior point method where complementarity is relaxed.
_FEW_INTERIOR = 100

#: Further attempts, each from the nearest solution so far.
_ROUNDS = 2


@dataclass(frozen=True)
class Batch:
    """B roots.

    Attributes:
        states: (B, T, N, n).
        controls: (B, T-1, N, m).
        costates: (B, T-1, N, n).
        residuals: (B,) max |G|.
        iterations: (B,) factorisations.
        tolerance: residual below which a point counts as a root.
    """

    states: np.ndarray
    controls: np.ndarray
    costates: np.ndarray
    residuals: np.ndarray
    iterations: np.ndarray
    tolerance: float

    @property
    def converged(self) -> np.ndarray:
        """(B,) booleans; where False, the trajectory is not a root."""
        return self.residuals < self.tolerance

    def root(self, index: int) -> Root:
        """One root, by its index."""
        return Root(
            self.states[index],
            self.controls[index],
            self.costates[index],
            float(self.residuals[index]),
        )


def solve_batch(
    game: Game,
    weights: np.ndarray,
    start: Root | Equilibrium,
    start_weights: np.ndarray,
    *,
    initial_states: np.ndarray | None = None,
    tolerance: float = 1e-10,
    max_iterations: int = 30,
    limit: float = 60.0,
    solver: Elimination | None = None,
) -> Batch:
    """Solve a game at many weights (B, N, K), or (B, N, K + U) with unknowns, from one equilibrium.

    Args:
        game: the game.
        weights: non-negative, scaled to row sums of one; standardised values of unknowns behind.
        start: the equilibrium to start from.
        start_weights: those of ``start``, (N, K) or (N, K + U).
        initial_states: (B, N, n) or (N, n); those of ``start`` where absent.
        tolerance: stop once max |G| falls below; the error of a root is some ten times as large.
        max_iterations: factorisations per game and start at most.
        limit: wall-clock seconds for the batch; games unsolved by then have not converged.
        solver: the game's elimination, with a relaxation of its own; built if None.

    Raises ValueError on a wrong shape, non-finite or negative values, or a singular start.
    """
    weights, start_weights = _check_weights(game, weights), game.check_theta(start_weights)
    initial_states = _check_initial_states(start.states[0], initial_states, len(weights))
    solver = solver or elimination(game)
    point = start.states, start.controls, start.costates, start_weights
    search = _Search(
        solver=linearised(game, *point, solver),
        point=pack(game, *point, solver),
        weights=start_weights.ravel(),
        tolerance=tolerance,
        max_iterations=min(_few(game, solver), max_iterations),
        rounds=0 if game.constraints else _ROUNDS,
        deadline=time.monotonic() + limit,
    )
    flat = weights.reshape(len(weights), start_weights.size)
    points, residuals, iterations = search.run(initial_states, flat)
    if game.constraints:
        _solve_forward(game, search, points, residuals, initial_states, flat)
    least = max(tolerance, RESIDUAL_TOLERANCE)
    return Batch(*unpack(game, points), residuals, iterations, tolerance=least)


def _few(game: Game, solver: Elimination) -> int:
    """Factorisations for each start."""
    if not game.constraints:
        return _FEW
    if not coupled_features(game).any():
        return _FEW_UNCOUPLED
    return _FEW_AT_BENDS if solver.relaxation > RELAXATION else _FEW_AT_KINKS


def _solve_forward(
    game: Game,
    search: "_Search",
    points: np.ndarray,
    residuals: np.ndarray,
    initial_states: np.ndarray,
    weights: np.ndarray,
) -> None:
    """Solve the games that are left by the interior point method, in place.

    Other constraints are active there. All start at the known motion: a game has the same solution
    whatever else is in the batch.
    """
    tolerance, shape = search.tolerance, game.state_shape[1:]
    known = unpack(game, search.point)
    most = _FEW_INTERIOR if search.solver.relaxation > RELAXATION else MOST_ITERATIONS
    for k in np.flatnonzero(~(residuals < tolerance)):
        if time.monotonic() > search.deadline:
            return
        states, controls, costates = (part.copy() for part in known)
        states[0] = initial_states[k].reshape(shape)
        theta = weights[k].reshape(game.num_players, -1)
        near = Root(states, controls, costates, np.inf)
        root = root_near(game, near, theta, max_iterations=most, solver=search.solver)
        if root.residual < tolerance:
            found = root.states, root.controls, root.costates
            points[k] = pack(game, *found, theta, search.solver)
            residuals[k] = root.residual


@dataclass
class _Search:
    """Roots at changes (B, N*n + N*K) of (x_1, theta) from a known root (T, size)."""

    solver: Elimination
    point: np.ndarray
    weights: np.ndarray
    tolerance: float
    max_iterations: int
    rounds: int
    deadline: float

    def run(
        self, initial_states: np.ndarray, weights: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points (B, T, size), residuals (B,) and factorisations (B,).

        All games start from the first-order prediction; those that fail, from the nearest solved
        one, and the game half-way between is solved as well, as a nearer start for the next round.
        """
        self.states = initial_states.shape[1]
        changes = np.hstack([initial_states - self.point[0, : self.states], weights - self.weights])
        columns = self.solver.sensitivities().reshape(self.point.size, -1)
        points = (changes[:, None] @ columns.T).reshape(-1, *self.point.shape)
        points += self.point
        points[:, 0, : self.states] = initial_states  # exact, without rounding
        residuals, iterations = self._improve(points, weights, factorised=len(points) == 1)
        helpers, helper_points = changes[:0], points[:0]
        for _ in range(self.rounds):
            solved = residuals < self.tolerance
            (left,), (done,) = np.nonzero(~solved), np.nonzero(solved)
            if not (left.size and done.size and time.monotonic() < self.deadline):
                break
            donors = np.concatenate([changes[done], helpers])
            _, nearest = cKDTree(donors).query(changes[left])
            half = (donors[nearest] + changes[left]) / 2
            source = np.concatenate([points[done], helper_points])[nearest]
            trial, found, more = self._carry(source, changes[left])
            better = found < residuals[left]
            points[left[better]], residuals[left[better]] = trial[better], found[better]
            iterations[left] += more
            trial, found, more = self._carry(source, half)
            good = found < self.tolerance
            helpers = np.concatenate([helpers, half[good]])
            helper_points = np.concatenate([helper_points, trial[good]])
            iterations[left] += more
        return points, residuals, iterations

    def _carry(
        self, source: np.ndarray, changes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Solve at ``changes`` from given points; returns points, residuals and factorisations."""
        trial = source.copy()
        trial[:, 0, : self.states] = self.point[0, : self.states] + changes[:, : self.states]
        found, steps = self._improve(trial, self.weights + changes[:, self.states :])
        return trial, found, steps

    def _improve(
        self, points: np.ndarray, weights: np.ndarray, *, factorised: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        return self.solver.newton(
            points,
            weights,
            tolerance=self.tolerance,
            max_iterations=self.max_iterations,
            limit=max(0.0, self.deadline - time.monotonic()),
            factorised=factorised,
        )


def _check_initial_states(
    first: np.ndarray, initial_states: np.ndarray | None, count: int
) -> np.ndarray:
    """Initial states (B, N*n); those of the start (N, n) if None."""
    initial_states = first if initial_states is None else np.asarray(initial_states, dtype=float)
    if initial_states.shape not in (first.shape, (count, *first.shape)):
        raise ValueError(
            f"initial_states have the shape {initial_states.shape}, expected {first.shape} "
            f"or {(count, *first.shape)}"
        )
    if not np.isfinite(initial_states).all():
        raise ValueError("initial_states must be finite")
    return np.broadcast_to(initial_states, (count, *first.shape)).reshape(count, first.size)


def _check_weights(game: Game, weights: np.ndarray) -> np.ndarray:
    theta = np.asarray(weights, dtype=float)
    expected = (game.num_players, game.num_weights + game.parameters.count)
    if theta.ndim != 3 or theta.shape[1:] != expected:
        raise ValueError(f"weights have the shape {theta.shape}, expected (B, *{expected})")
    weights, parameters = np.split(theta, [game.num_weights], axis=2)
    totals = weights.sum(axis=2, keepdims=True)
    # NaN compares false.
    bad = ~((weights >= 0) & np.isfinite(weights) & (totals > 0)).all(axis=(1, 2))
    bad |= ~np.isfinite(parameters).all(axis=(1, 2))
    if bad.any():
        raise ValueError(
            f"weights must be finite, non-negative and positive for each player; entry "
            f"{int(np.argmax(bad))} of the batch is not"
        )
    return np.concatenate([weights / totals, parameters], axis=2)
