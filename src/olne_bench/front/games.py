"""Solve a game, and what can be known of it."""

import numpy as np

from olne_bench.estimators.protocol import Problem
from olne_bench.games.model.equilibrium import Equilibrium
from olne_bench.games.model.game import Game
from olne_bench.games.solve import olne
from olne_bench.games.solve.information import observation_sensitivity
from olne_bench.games.solve.olne import RESIDUAL_TOLERANCE


class NoRootError(ValueError):
    """No root of a game's first-order conditions was found, so there is no motion to show."""


def solve_olne(
    game: Game,
    weights: np.ndarray,
    initial_state: np.ndarray,
    *,
    initial_controls: np.ndarray | None = None,
    search_far: bool = False,
) -> Equilibrium:
    """Find an open-loop Nash equilibrium, the variational one where the game has constraints.

    Args:
        game: the game.
        weights: (N, K), non-negative, scaled to row sums of one.
        initial_state: (N, n).
        initial_controls: (T-1, N, m) start of the iteration. Default: zeros (coasting).
        search_far: also look for better responses far away, and follow them.

    Returns:
        The equilibrium. ``certificate.passed`` says whether no player gains by a small change of
        its plan; a root that fails there is a saddle point of some player's cost.

    Raises:
        NoRootError: where no root was found; a ``ValueError``.
        ValueError: on arguments of a wrong shape or non-finite values.
    """
    if not isinstance(game, Game):
        raise TypeError(f"game must be a Game, got {game!r}; a scenario has one: scenario.game")
    found = olne.solve_olne(
        game, weights, initial_state, initial_controls=initial_controls, search_far=search_far
    )
    if not found.residual < RESIDUAL_TOLERANCE:
        raise NoRootError(
            f"no root of the game was found: the first-order conditions are off by "
            f"{found.residual:.1e}, a root by less than {RESIDUAL_TOLERANCE:g}; try other "
            "initial_controls, or a shorter horizon"
        )
    return found


def fisher_information(
    problem: Problem, equilibrium: Equilibrium, weights: np.ndarray
) -> np.ndarray:
    """What one observation of an equilibrium says about the weights.

    Args:
        problem: game, view and noise; its sigma is positive.
        equilibrium: of the problem's game at these weights.
        weights: (N, K), or (N, K + U) with standardised parameters where the game has unknowns.

    Returns:
        (P, P) Fisher information of weights and, after them, of the initial state (N, n), all in C
        order. Weights are on no simplex here: a scaling of a row is a direction of no information.

    Raises:
        ValueError: without noise, or if the equilibrium is singular.
    """
    if not problem.sigma > 0:
        raise ValueError(
            f"sigma must be positive, got {problem.sigma}: without noise, all is known"
        )
    rows = observation_sensitivity(
        problem.game,
        problem.view,
        equilibrium.states,
        equilibrium.controls,
        equilibrium.costates,
        problem.game.check_theta(weights),
        noise_scale=problem.noise_scale,
        noise_covariance=problem.noise_covariance,
    )
    return np.asarray(rows.T @ rows / problem.sigma**2)
