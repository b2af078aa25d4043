"""Newton's method on the stacked first-order conditions G(z; theta, x_1) = 0."""

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from games.game import Game
from games.kkt import kkt_system

#: Smallest step length tried before the line search gives up.
_SMALLEST_STEP = 2.0**-12


@dataclass(frozen=True)
class Root:
    """A point of the Newton iteration: states (T, N, n), controls, costates, max |G|."""

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
) -> Root:
    """Polish a trajectory into a root of G by Newton steps with backtracking on |G|_2.

    Args:
        game: the game.
        states: (T, N, n) start; its first row is x_1 and stays.
        controls: (T-1, N, m) start.
        costates: (T-1, N, n) start.
        weights: (N, K).
        tolerance: stop once max |G| falls below.
        max_iterations: stop at the latest after as many steps.

    Returns:
        The best point reached; the caller judges its ``residual``.
    """
    evaluate, jacobian = _newton_functions(game)
    parameters = (states[0].ravel(), weights.ravel())
    point = np.concatenate([states[1:].ravel(), controls.ravel(), costates.ravel()])
    value = _vector(evaluate(point, *parameters))
    for _ in range(max_iterations):
        if np.abs(value).max() < tolerance:
            break
        try:
            step = splu(csc_matrix(jacobian(point, *parameters))).solve(-value)
        except RuntimeError:  # exactly singular
            break
        length = 1.0
        while length >= _SMALLEST_STEP:
            trial = point + length * step
            trial_value = _vector(evaluate(trial, *parameters))
            # NaN compares false, so an undefined trial point is refused as well.
            if np.linalg.norm(trial_value) < (1 - 1e-4 * length) * np.linalg.norm(value):
                break
            length /= 2
        else:
            break
        point, value = trial, trial_value

    head = states[1:].size
    tail = head + controls.size
    return Root(
        states=np.concatenate([states[:1], point[:head].reshape(states[1:].shape)]),
        controls=point[head:tail].reshape(controls.shape),
        costates=point[tail:].reshape(costates.shape),
        residual=float(np.abs(value).max()),
    )


def _vector(value: ca.DM) -> np.ndarray:
    return np.array(value).ravel()


@lru_cache(maxsize=64)
def _newton_functions(game: Game) -> tuple[ca.Function, ca.Function]:
    system = kkt_system(game)
    arguments = [system.unknowns, system.initial_state, system.weights]
    jacobian = ca.jacobian(system.residual, system.unknowns)
    return (
        ca.Function("G", arguments, [system.residual]),
        ca.Function("G_z", arguments, [jacobian]),
    )
