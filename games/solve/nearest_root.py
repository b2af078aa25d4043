"""The forward game's root nearest to a reference trajectory, the published study's prediction.

The published study scores an estimate by the root at its weights nearest to the true trajectory:
IPOPT minimises |x - x_true|^2 subject to G(x, u, lambda; theta) = 0, starting at the true
trajectory with zero costates. An estimate counts as failed if this does not converge within IPOPT's
default limits, which is partly chance: perturbing the true trajectory by 1e-13 changes the verdict
on many estimates (``scripts/forward_luck.py``). It is kept (``Prediction.published``); if it is
negative, the search continues along the path of roots from the true weights, and by continuation in
the coupling between players (``games.solve.root_following``). Equilibria far from the observed
motion are not searched for, as they predict nothing.
"""

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from olne_bench.games.model.game import Game
from olne_bench.games.solve.ipopt import PUBLISHED_ITERATIONS, QUIET
from olne_bench.games.solve.kkt import kkt_system
from olne_bench.games.solve.newton import Root
from olne_bench.games.solve.root_following import follow_root, follow_weights


@dataclass(frozen=True)
class Prediction:
    """The predicted motion of the players.

    Attributes:
        root: a root of the first-order conditions; None if none was found.
        published: whether the published study's single solve found it.
    """

    root: Root | None
    published: bool


def predict(
    game: Game,
    weights: np.ndarray,
    truth: Root,
    true_weights: np.ndarray,
    *,
    max_iterations: int = PUBLISHED_ITERATIONS,
) -> Prediction:
    """Find the root of G nearest to the true motion at weights (N, K), or (N, K + U) with unknowns.

    That of the published solve, limited to ``max_iterations`` of IPOPT, or else that of
    ``follow_root``. With constraints, unknowns or 0 iterations it is always the latter, and counts
    as published where the path from the true weights leads to it.
    """
    if game.constraints or game.parameters.count or not max_iterations:
        root = follow_weights(game, truth, true_weights, weights)
        if root is not None:
            return Prediction(root, published=True)
        return Prediction(follow_root(game, truth, true_weights, weights), published=False)
    states, controls, zero = truth.states, truth.controls, np.zeros_like(truth.costates)
    root = nearest_root(game, weights, states, controls, zero, max_iterations=max_iterations)
    if root is not None:
        return Prediction(root, published=True)
    return Prediction(follow_root(game, truth, true_weights, weights), published=False)


def nearest_root(
    game: Game,
    weights: np.ndarray,
    states: np.ndarray,
    controls: np.ndarray,
    costates: np.ndarray,
    *,
    max_iterations: int = PUBLISHED_ITERATIONS,
) -> Root | None:
    """One solve by IPOPT for the root of G nearest to a motion, from there; None if it fails.

    Weights are (N, K), states (T, N, n), controls (T-1, N, m), costates (T-1, N, n).
    """
    solver = _root_solver(game, max_iterations)
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
def _root_solver(game: Game, max_iterations: int) -> ca.Function:
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
    # Suits these systems: up to 1.7 times faster, with the same iterates up to rounding.
    linear_algebra = {
        "ipopt.mumps_pivot_order": 0,
        "ipopt.mumps_permuting_scaling": 0,
        "ipopt.min_refinement_steps": 0,
    }
    options = QUIET | linear_algebra | {"ipopt.max_iter": max_iterations}
    return ca.nlpsol("nearest_root", "ipopt", problem, options)
