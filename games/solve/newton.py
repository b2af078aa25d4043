"""Newton's method on the stacked first-order conditions G(z; theta, x_1) = 0."""

from dataclasses import dataclass

import numpy as np

from olne_bench.games.compiled.elimination import Elimination, elimination
from olne_bench.games.model.game import Game


@dataclass(frozen=True)
class Root:
    """A point of the Newton iteration.

    States (T, N, n), controls (T-1, N, m), costates (T-1, N, n) and the residual max |G|. Where
    there are constraints, their multipliers follow from the margins (``pack``), and the costates
    leave out what constraints on the next state add to them (``games.compiled.complementarity``).
    """

    states: np.ndarray
    controls: np.ndarray
    costates: np.ndarray
    residual: float


def newton_root(
    game: Game,
    states: np.ndarray,
    controls: np.ndarray,
    costates: np.ndarray,
    weights: np.ndarray,
    *,
    tolerance: float = 1e-12,
    max_iterations: int = 50,
    limit: float = 60.0,
) -> Root:
    """Refine a trajectory, but its first state, to a root of G by Newton steps with backtracking.

    It stops after ``limit`` seconds of wall-clock time with the best point; callers judge its
    residual.
    """
    points = pack(game, states, controls, costates, weights)[None]
    residuals, _ = elimination(game).newton(
        points,
        np.asarray(weights, dtype=float).reshape(1, -1),
        tolerance=tolerance,
        max_iterations=max_iterations,
        limit=limit,
    )
    return Root(*unpack(game, points[0]), residual=float(residuals[0]))


def pack(
    game: Game,
    states: np.ndarray,
    controls: np.ndarray,
    costates: np.ndarray,
    weights: np.ndarray,
    solver: Elimination | None = None,
) -> np.ndarray:
    """Rows z_t = (x_t, u_t, lambda_t) (..., T, size) of ``games.compiled.elimination``.

    Where the game has constraints, u_t holds their multipliers, too: those that belong to the
    margins, tau / g, and zero where the margins are negative (``games.compiled.complementarity``).
    Margins depend on the weights (N, K + U) by the unknowns of constraints.
    """
    if not game.constraints:
        return rows(game, states, controls, costates)
    solver = solver or elimination(game)
    z = rows(game, states, controls, costates, solver.stages.num_multipliers)
    return with_multipliers(solver, z, weights)


def with_multipliers(solver: Elimination, z: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Rows (..., T, size) with the multipliers that belong to the margins."""
    stages = solver.stages
    end = stages.num_states + stages.num_controls
    place, on = slice(end - stages.num_multipliers, end), solver.enforced[:-1]
    theta = np.asarray(weights, dtype=float).ravel()
    for point in z.reshape(-1, *z.shape[-2:]):
        margins = np.where(on, solver.step_margins(point, theta), 1.0)
        positive = margins > 0
        point[:-1, place] = np.divide(
            solver.relaxation, margins, out=np.zeros_like(margins), where=positive
        )
    return z


def rows(
    game: Game,
    states: np.ndarray,
    controls: np.ndarray,
    costates: np.ndarray,
    num_multipliers: int = 0,
) -> np.ndarray:
    """Rows (..., T, size) with so many multipliers, which are zero."""
    lead, (steps, players, n) = states.shape[:-3], game.state_shape
    inputs = players * n, players * game.dynamics.control_size
    z = np.zeros((*lead, steps, 2 * inputs[0] + inputs[1] + num_multipliers))
    z[..., : inputs[0]] = states.reshape(*lead, steps, -1)
    z[..., :-1, inputs[0] : sum(inputs)] = controls.reshape(*lead, steps - 1, -1)
    z[..., :-1, z.shape[-1] - inputs[0] :] = costates.reshape(*lead, steps - 1, -1)
    return z


def unpack(game: Game, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """States (..., T, N, n), controls and costates of rows z_t; the inverse of ``pack``."""
    lead, (steps, players, n) = z.shape[:-2], game.state_shape
    inputs = players * n, players * game.dynamics.control_size
    own = (*lead, steps - 1, players)
    return (
        z[..., : inputs[0]].reshape(*lead, steps, players, n).copy(),
        z[..., :-1, inputs[0] : sum(inputs)].reshape(*own, game.dynamics.control_size).copy(),
        z[..., :-1, z.shape[-1] - inputs[0] :].reshape(*own, n).copy(),
    )


def linearised(
    game: Game,
    states: np.ndarray,
    controls: np.ndarray,
    costates: np.ndarray,
    weights: np.ndarray,
    solver: Elimination | None = None,
) -> Elimination:
    """The game's elimination, given or built, factorised at a point; ValueError if singular."""
    solver = solver or elimination(game)
    z = pack(game, states, controls, costates, weights, solver)
    if not solver.linearise(z, np.asarray(weights, dtype=float).ravel()):
        raise ValueError("the first-order conditions are singular at this trajectory")
    return solver
