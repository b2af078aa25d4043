"""Forward games: find an open-loop Nash equilibrium and certify it.

Roots of the stacked first-order conditions come from two sources. Continuation in the coupling
between the players takes milliseconds but may end at a saddle point of some player's cost. If the
certificate fails, iterated best response (IBR, Wang et al. 2019; the paper's ground truth) leads
into the basin of a true equilibrium, and Newton's method brings the residual to machine precision.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from olne_bench.games.best_response import best_response
from olne_bench.games.continuation import follow_coupling
from olne_bench.games.dynamics import rollout
from olne_bench.games.game import Game
from olne_bench.games.kkt import kkt_system
from olne_bench.games.newton import Root, newton_root

#: Default certificate tolerance: largest gain of any player, relative to 1 + |J^i|.
CERTIFICATE_TOLERANCE = 1e-7

#: A point with a residual below this counts as a root of the first-order conditions.
RESIDUAL_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Certificate:
    """Evidence that no player gains by deviating alone (eqn. nash, locally).

    Each player's best response is computed from two starts, its equilibrium trajectory and a
    perturbed one, which leaves saddle points of its cost.

    Attributes:
        gains: (N,) J^i(equilibrium) - J^i(better of the two responses); about 0 or negative at an
            equilibrium.
        costs: (N,) J^i at the equilibrium.
        tolerance: allowed gain relative to 1 + |J^i|.
        passed: whether every player's gain is within the tolerance and G is zero.
    """

    gains: np.ndarray
    costs: np.ndarray
    tolerance: float
    passed: bool


@dataclass(frozen=True)
class Equilibrium:
    """A solution of a forward game.

    Attributes:
        states: (T, N, n).
        controls: (T-1, N, m).
        costates: (T-1, N, n), of each player's own state.
        residual: max |G|.
        certificate: evidence; ``certificate.passed`` is False if the solver failed.
    """

    states: np.ndarray
    controls: np.ndarray
    costates: np.ndarray
    residual: float
    certificate: Certificate


def solve_olne(
    game: Game,
    weights: np.ndarray,
    initial_state: np.ndarray,
    *,
    initial_controls: np.ndarray | None = None,
    certificate_tolerance: float = CERTIFICATE_TOLERANCE,
    max_rounds: int = 100,
) -> Equilibrium:
    """Find an open-loop Nash equilibrium.

    Args:
        game: the game.
        weights: (N, K), non-negative, scaled to row sums of one.
        initial_state: (N, n).
        initial_controls: (T-1, N, m) start of the iteration; zeros (coasting) if None.
        certificate_tolerance: largest gain that a player may have from deviating alone,
            relative to 1 + |J^i|.
        max_rounds: rounds of best responses per attempt.

    Returns:
        The first certified equilibrium among the attempts (continuation, plain IBR, damped
        IBR), or the last attempt with ``certificate.passed`` False. A game without a solution does
        not raise.

    Raises:
        ValueError: on arguments of a wrong shape or non-finite values.
    """
    weights = game.check_weights(weights)
    initial_state = game.check_initial_state(initial_state)
    if initial_controls is None:
        initial_controls = np.zeros(game.control_shape)
    initial_controls = np.asarray(initial_controls, dtype=float)
    if initial_controls.shape != game.control_shape:
        raise ValueError(
            f"initial_controls have the shape {initial_controls.shape}, "
            f"expected {game.control_shape}"
        )

    for guess in _guesses(game, weights, initial_state, initial_controls, max_rounds):
        root = newton_root(game, guess.states, guess.controls, guess.costates, weights)
        certificate = certify(game, root, weights, tolerance=certificate_tolerance)
        if certificate.passed:
            break
    return Equilibrium(root.states, root.controls, root.costates, root.residual, certificate)


def certify(
    game: Game,
    root: Root | Equilibrium,
    weights: np.ndarray,
    *,
    tolerance: float = CERTIFICATE_TOLERANCE,
) -> Certificate:
    """Check by best responses that no player gains by deviating alone.

    Args:
        game: the game.
        root: the point to check.
        weights: (N, K).
        tolerance: allowed gain relative to 1 + |J^i|.
    """
    function = kkt_system(game).cost_function
    costs = np.array(function(root.states.ravel(), root.controls.ravel(), weights.ravel())).ravel()
    if not (root.residual < RESIDUAL_TOLERANCE and np.isfinite(costs).all()):
        return Certificate(np.full(game.num_players, np.nan), costs, tolerance, passed=False)

    rng = np.random.default_rng(0)  # any fixed direction off the symmetry axes will do
    perturbed = root.controls + 1e-3 * rng.standard_normal(root.controls.shape)
    starts = (
        (root.states, root.controls),
        (rollout(game.dynamics, root.states[0], perturbed, game.dt), perturbed),
    )
    gains = np.empty(game.num_players)
    solved = True
    for i in range(game.num_players):
        responses = []
        for own_states, own_controls in starts:
            states, controls = root.states.copy(), root.controls.copy()
            states[:, i], controls[:, i] = own_states[:, i], own_controls[:, i]
            responses.append(best_response(game, i, states, controls, weights[i]))
        solved = solved and all(response.converged for response in responses)
        gains[i] = costs[i] - min(response.cost for response in responses)
    passed = solved and bool((gains <= tolerance * (1 + np.abs(costs))).all())
    return Certificate(gains, costs, tolerance, passed)


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


def iterated_best_response(
    game: Game,
    weights: np.ndarray,
    initial_state: np.ndarray,
    controls: np.ndarray,
    *,
    max_rounds: int = 100,
    max_iterations: int = 1500,
    damping: float = 1.0,
    tolerance: float = 1e-3,
) -> Root:
    """Let the players respond in turn until their plans no longer change (Wang et al. 2019).

    Args:
        game: the game.
        weights: (N, K).
        initial_state: (N, n).
        controls: (T-1, N, m) first plans.
        max_rounds: rounds through all players.
        max_iterations: total iterations of the players' optimisers, after which no round starts.
        damping: share of the step towards its response that a player takes.
        tolerance: stop when no control changes by more than this in one round.

    Returns:
        The last plans; the residual is infinity, as IBR does not evaluate G.
    """
    controls = controls.copy()
    states = rollout(game.dynamics, initial_state, controls, game.dt)
    costates = np.zeros((game.horizon - 1, *initial_state.shape))
    used = 0
    for _ in range(max_rounds):
        before = controls.copy()
        for i in range(game.num_players):
            response = best_response(game, i, states, controls, weights[i])
            used += response.iterations
            controls[:, i] += damping * (response.controls - controls[:, i])
            costates[:, i] = response.costates
            states[:, i] = rollout(game.dynamics, initial_state, controls, game.dt)[:, i]
        if np.abs(controls - before).max() < tolerance * damping or used >= max_iterations:
            break
    return Root(states, controls, costates, residual=float("inf"))
