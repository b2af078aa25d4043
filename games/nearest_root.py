"""The forward game's root nearest a reference trajectory: the study's way of predicting.

The published study scores an estimate by a root of the first-order conditions at the estimated
weights. As a game may have several, it takes the one nearest the true trajectory: IPOPT minimises
|x - x_true|^2 subject to G(x, u, lambda; theta) = 0, started at the true trajectory. Where IPOPT
does not converge at its default limits, the estimate counts as a failure.

The costates start at the values that make the true trajectory stationary in its states at the
estimated weights. Started at zero, IPOPT loses its way now and then at weights next to the true
ones, where a root is at hand; such accidents say nothing about an estimate.
"""

from functools import lru_cache

import casadi as ca
import numpy as np

from games.game import Game
from games.ipopt import QUIET
from games.kkt import consistent_costates, kkt_system
from games.newton import Root


def nearest_root(
    game: Game, weights: np.ndarray, states: np.ndarray, controls: np.ndarray
) -> Root | None:
    """Find the root of G at the given weights nearest a reference trajectory.

    Args:
        game: the game.
        weights: (N, K).
        states: (T, N, n) reference, its first row the initial state; also the start.
        controls: (T-1, N, m) start.

    Returns:
        The root, or None where IPOPT does not converge: an ill-conditioned game.
    """
    solver = _root_solver(game)
    costates = consistent_costates(game, states, controls, weights)
    start = np.concatenate([states[1:].ravel(), controls.ravel(), costates.ravel()])
    solution = solver(x0=start, p=np.concatenate([states.ravel(), weights.ravel()]), lbg=0, ubg=0)
    if not solver.stats()["success"]:
        return None
    point = np.array(solution["x"]).ravel()
    head = states[1:].size
    tail = head + controls.size
    return Root(
        states=np.concatenate([states[:1], point[:head].reshape(states[1:].shape)]),
        controls=point[head:tail].reshape(controls.shape),
        costates=point[tail:].reshape(costates.shape),
        residual=float(np.abs(np.array(solution["g"])).max()),
    )


@lru_cache(maxsize=32)
def _root_solver(game: Game) -> ca.Function:
    system = kkt_system(game)
    reference = ca.SX.sym("x_true", system.states.numel())
    initial = system.initial_state.numel()
    # x_1 is data here, so it is replaced by the head of the reference.
    residual = ca.substitute(system.residual, system.initial_state, reference[:initial])
    problem = {
        "x": system.unknowns,
        "p": ca.vertcat(reference, system.weights),
        "f": ca.sumsqr(system.states[initial:] - reference[initial:]),
        "g": residual,
    }
    return ca.nlpsol("nearest_root", "ipopt", problem, QUIET)
