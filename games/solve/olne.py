"""Forward games: find an open-loop Nash equilibrium and certify it.

Continuation in the coupling between the players takes milliseconds but may end at a saddle point of
some player's cost. If the certificate fails, iterated best response (IBR, Wang et al. 2019; the
paper's ground truth) leads into the basin of a true equilibrium, and Newton's method brings the
residual to machine precision. Where asked, better responses are looked for far away
(``games.solve.far_search``): a player takes its own, the others respond in turn, and the next
equilibrium is examined.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from olne_bench.games.compiled.elimination import elimination
from olne_bench.games.model.equilibrium import (
    CERTIFICATE_TOLERANCE,
    Certificate,
    Equilibrium,
    Gains,
)
from olne_bench.games.model.game import Game
from olne_bench.games.solve.best_response import best_responses, iterated_best_response
from olne_bench.games.solve.constrained import certify_constrained, solve_constrained
from olne_bench.games.solve.continuation import follow_coupling
from olne_bench.games.solve.far_search import FarResponses, far_responses
from olne_bench.games.solve.newton import Root, newton_root, rows

__all__ = [
    "CERTIFICATE_TOLERANCE",
    "RESIDUAL_TOLERANCE",
    "Certificate",
    "Equilibrium",
    "Gains",
    "certify",
    "iterated_best_response",
    "solve_olne",
]

#: Equilibria that are examined for better responses far away.
_MOST_EQUILIBRIA = 10

#: A point with a residual below this counts as a root of the first-order conditions.
RESIDUAL_TOLERANCE = 1e-9


def solve_olne(
    game: Game,
    weights: np.ndarray,
    initial_state: np.ndarray,
    *,
    initial_controls: np.ndarray | None = None,
    certificate_tolerance: float = CERTIFICATE_TOLERANCE,
    max_rounds: int = 100,
    search_far: bool = False,
) -> Equilibrium:
    """Find an open-loop Nash equilibrium, the variational one where the game has constraints.

    Args:
        game: the game.
        weights: (N, K), non-negative, scaled to row sums of one.
        initial_state: (N, n).
        initial_controls: (T-1, N, m) start of the iteration; zeros (coasting) if None.
        certificate_tolerance: largest gain by deviating alone, relative to 1 + |J^i|.
        max_rounds: rounds of best responses per attempt.
        search_far: also look for better responses far away, and follow them; not with constraints.

    Returns:
        The first locally certified equilibrium among the attempts (continuation, plain IBR, damped
        IBR), or the last attempt with ``certificate.passed`` False. With ``search_far``, the first
        without a better response far away, or else the first, its certificate with the gains.

    Raises:
        ValueError: on a wrong shape, non-finite values, or a start that breaks constraints.
    """
    weights = game.check_weights(weights)
    initial_state = game.check_initial_state(initial_state)
    initial_controls = _checked_controls(game, initial_controls)

    if game.constraints:
        start = initial_state, initial_controls
        return solve_constrained(game, weights, *start, tolerance=certificate_tolerance)
    for guess in _guesses(game, weights, initial_state, initial_controls, max_rounds):
        root = newton_root(game, guess.states, guess.controls, guess.costates, weights)
        certificate = certify(game, root, weights, tolerance=certificate_tolerance)
        if certificate.passed:
            break
    if search_far and certificate.passed:
        root, certificate = _without_better_far(game, weights, root, certificate, max_rounds)
    return Equilibrium(root.states, root.controls, root.costates, root.residual, certificate)


def _checked_controls(game: Game, controls: np.ndarray | None) -> np.ndarray:
    if controls is None:
        return np.zeros(game.control_shape)
    controls = np.asarray(controls, dtype=float)
    if controls.shape != game.control_shape:
        raise ValueError(
            f"initial_controls have the shape {controls.shape}, expected {game.control_shape}"
        )
    return controls


def certify(
    game: Game,
    root: Root | Equilibrium,
    weights: np.ndarray,
    *,
    tolerance: float = CERTIFICATE_TOLERANCE,
    search_far: bool = False,
) -> Certificate:
    """Check by best responses at weights (N, K) that no player gains by deviating alone.

    A gain up to ``tolerance``, relative to 1 + |J^i|, is allowed. With ``search_far``, better
    responses far away are looked for, if none is near; not where the game has constraints.
    """
    if game.constraints:
        return certify_constrained(game, root, weights, tolerance=tolerance)
    certificate = _certify_near(game, root, weights, tolerance)
    if search_far and certificate.local.passed:
        certificate, _ = _certify_far(game, root, weights, certificate)
    return certificate


def _certify_near(
    game: Game, root: Root | Equilibrium, weights: np.ndarray, tolerance: float
) -> Certificate:
    z = rows(game, root.states, root.controls, root.costates)
    costs = elimination(game).costs(z, np.ravel(weights))
    plans = _near_plans(root.controls)
    starts = np.full(game.num_players, len(plans))
    if not (root.residual < RESIDUAL_TOLERANCE and np.isfinite(costs).all()):
        nothing = np.full(game.num_players, np.nan)
        return Certificate(costs, tolerance, Gains(nothing, 0 * starts, passed=False))
    gains = np.empty(game.num_players)
    solved = True
    for i in range(game.num_players):
        responses = best_responses(game, i, plans[:, :, i], root.states, root.controls, weights)
        solved = solved and bool(responses.converged.all())
        gains[i] = costs[i] - responses.costs.min()
    passed = solved and _within(gains, costs, tolerance)
    return Certificate(costs, tolerance, Gains(gains, starts, passed))


def _near_plans(controls: np.ndarray) -> np.ndarray:
    """Plans (2, T-1, N, m): the given ones, and perturbed ones."""
    rng = np.random.default_rng(0)  # any fixed direction off the symmetry axes will do
    return np.stack([controls, controls + 1e-3 * rng.standard_normal(controls.shape)])


def _certify_far(
    game: Game, root: Root | Equilibrium, weights: np.ndarray, near: Certificate
) -> tuple[Certificate, FarResponses]:
    """The certificate with its far part, and the plans that it found."""
    found = far_responses(game, root.states, root.controls, weights)
    gains = near.costs - found.costs
    passed = _within(gains, near.costs, near.tolerance)
    return replace(near, global_so_far=Gains(gains, found.starts, passed)), found


def _within(gains: np.ndarray, costs: np.ndarray, tolerance: float) -> bool:
    return bool((gains <= tolerance * (1 + np.abs(costs))).all())


def _without_better_far(
    game: Game, weights: np.ndarray, root: Root, near: Certificate, max_rounds: int
) -> tuple[Root, Certificate]:
    """An equilibrium without a better response far away; if none is found, the given one."""
    examined: list[tuple[Root, Certificate]] = []
    while near.passed and len(examined) < _MOST_EQUILIBRIA:
        certificate, far = _certify_far(game, root, weights, near)
        if certificate.passed:
            return root, certificate
        examined.append((root, certificate))
        player = int(np.argmax(certificate.gains / (1 + np.abs(certificate.costs))))
        controls = root.controls.copy()
        controls[:, player] = far.controls[:, player]
        guess = iterated_best_response(
            game, weights, root.states[0], controls, max_rounds=max_rounds, first=player
        )
        root = newton_root(game, guess.states, guess.controls, guess.costates, weights)
        near = _certify_near(game, root, weights, near.tolerance)
    return examined[0]


def _guesses(
    game: Game,
    weights: np.ndarray,
    initial_state: np.ndarray,
    controls: np.ndarray,
    max_rounds: int,
) -> Iterator[Root]:
    """Starting points for Newton's method, cheapest first."""
    root = follow_coupling(game, weights, initial_state, controls)
    if root is not None:
        yield root
    for damping in (1.0, 0.5):
        yield iterated_best_response(
            game, weights, initial_state, controls, max_rounds=max_rounds, damping=damping
        )
