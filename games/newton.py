"""Newton's method on the stacked first-order conditions G(z; theta, x_1) = 0."""

from dataclasses import dataclass

import numpy as np

from olne_bench.games.elimination import Elimination
from olne_bench.games.game import Game
from olne_bench.games.native import elimination
from olne_bench.games.observation import View


@dataclass(frozen=True)
class Root:
    """A point of the Newton iteration.

    States (T, N, n), controls (T-1, N, m), costates (T-1, N, n) and the residual max |G|.
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
    view: View | None = None,
) -> Root:
    """Refine a trajectory to a root of G by Newton steps with backtracking on |G|_2.

    Args:
        game: the game.
        states: (T, N, n) start; its first row is x_1 and stays fixed.
        controls: (T-1, N, m) start.
        costates: (T-1, N, n) start.
        weights: (N, K).
        tolerance: stop once max |G| falls below.
        max_iterations: largest number of steps.
        limit: stop at the latest after as many wall-clock seconds.
        view: the observation model, where the game is to be solved often enough for compiled code
            of its own (``games.native.elimination``).

    Returns:
        The best point reached; the caller judges its ``residual``.
    """
    points = pack(game, states, controls, costates)[None]
    residuals, _ = elimination(game, view).newton(
        points,
        np.asarray(weights, dtype=float).reshape(1, -1),
        tolerance=tolerance,
        max_iterations=max_iterations,
        limit=limit,
    )
    return Root(*unpack(game, points[0]), residual=float(residuals[0]))


def pack(game: Game, states: np.ndarray, controls: np.ndarray, costates: np.ndarray) -> np.ndarray:
    """Rows z_t = (x_t, u_t, lambda_t) (..., T, size) of ``games.elimination``."""
    lead, (steps, players, n) = states.shape[:-3], game.state_shape
    inputs = players * n, players * game.dynamics.control_size
    z = np.zeros((*lead, steps, 2 * inputs[0] + inputs[1]))
    z[..., : inputs[0]] = states.reshape(*lead, steps, -1)
    z[..., :-1, inputs[0] : sum(inputs)] = controls.reshape(*lead, steps - 1, -1)
    z[..., :-1, sum(inputs) :] = costates.reshape(*lead, steps - 1, -1)
    return z


def unpack(game: Game, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """States (..., T, N, n), controls and costates of rows z_t; the inverse of ``pack``."""
    lead, (steps, players, n) = z.shape[:-2], game.state_shape
    inputs = players * n, players * game.dynamics.control_size
    own = (*lead, steps - 1, players)
    return (
        z[..., : inputs[0]].reshape(*lead, steps, players, n).copy(),
        z[..., :-1, inputs[0] : sum(inputs)].reshape(*own, game.dynamics.control_size).copy(),
        z[..., :-1, sum(inputs) :].reshape(*own, n).copy(),
    )


def linearised(
    game: Game,
    states: np.ndarray,
    controls: np.ndarray,
    costates: np.ndarray,
    weights: np.ndarray,
    solver: Elimination | None = None,
) -> Elimination:
    """The game's elimination, factorised at a point; ``solver`` is used if it is given.

    Raises:
        ValueError: if the first-order conditions are singular at the point.
    """
    solver = solver or elimination(game)
    z = pack(game, states, controls, costates)
    if not solver.linearise(z, np.asarray(weights, dtype=float).ravel()):
        raise ValueError("the first-order conditions are singular at this trajectory")
    return solver
