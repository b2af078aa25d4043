"""A game's root at other weights, followed from a known one: far cheaper than ``nearest_root``."""

import numpy as np

from olne_bench.games.model.game import Game
from olne_bench.games.solve.batch import solve_batch
from olne_bench.games.solve.constrained import as_root, variational_solution
from olne_bench.games.solve.continuation import follow_coupling
from olne_bench.games.solve.newton import Root
from olne_bench.games.solve.olne import RESIDUAL_TOLERANCE

#: Newton steps that the continuation may take. A limit in seconds would make the verdict depend on
#: the machine.
_COUPLING_STEPS = 60


def follow_root(
    game: Game, known: Root, known_weights: np.ndarray, weights: np.ndarray
) -> Root | None:
    """The root at other weights, from the same initial state; None if a few dozen steps find none.

    It is followed from the known root. If that fails, continuation in the coupling between players
    is tried, first from the known controls, then from coasting as in the forward solver
    (``games.solve.olne``): each of the two starts solves some games that the other does not.
    """
    return (
        follow_weights(game, known, known_weights, weights)
        or from_independent_players(game, known.states[0], known.controls, weights)
        or from_independent_players(game, known.states[0], np.zeros(game.control_shape), weights)
    )


def follow_weights(
    game: Game, known: Root, known_weights: np.ndarray, weights: np.ndarray
) -> Root | None:
    """First part of ``follow_root``: the root on a path from the known one, or None."""
    try:
        batch = solve_batch(game, weights[None], known, known_weights)
    except ValueError:  # the known root is singular
        return None
    return batch.root(0) if batch.converged[0] else None


def from_independent_players(
    game: Game, initial_state: np.ndarray, controls: np.ndarray, weights: np.ndarray
) -> Root | None:
    """``follow_root`` without it: continuation or, under constraints, the interior point method."""
    if game.constraints:
        try:
            solution = variational_solution(game, weights, initial_state, controls)
        except ValueError:  # the start breaks a constraint
            return None
        found, _ = as_root(game, solution, weights)
        return found if found.residual < RESIDUAL_TOLERANCE else None
    root = follow_coupling(
        game, weights, initial_state, controls, max_factorisations=_COUPLING_STEPS
    )
    return root if root is not None and root.residual < RESIDUAL_TOLERANCE else None
