"""What players do if they do not play the open-loop Nash equilibrium: five other behaviours.

- ``feedback``: each knows how the others would react to it (``feedback``).
- ``responding``: each responds best to others that drive as if they were alone (level one).
- ``leading``: the first player chooses its plan knowing how the others respond to it (Stackelberg).
- ``alone``: nobody minds the others.
- ``straight``: nobody steers or accelerates.
"""

from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from olne_bench.games.model.costs import CarProximity, Feature, Following, Proximity
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.game import Game
from olne_bench.games.solve.best_response import best_responses, iterated_best_response
from olne_bench.games.solve.feedback import solve_feedback
from olne_bench.games.solve.plan_costs import PlanCosts

#: Those that ``plans`` knows.
BEHAVIOURS = ("feedback", "responding", "leading", "alone", "straight")

#: Rounds in which followers respond to each other, and change [control units] that ends them.
_ROUNDS, _SETTLED = 30, 1e-9
#: Iterations of the leader's search.
_ITERATIONS = 20
#: Curvature of a cost, relative to the largest, that counts at least: no draw is without bounds.
_FLATTEST = 1e-6


class NoPlanError(Exception):
    """No plans of this behaviour are found."""


def plans(
    game: Game, behaviour: str, weights: np.ndarray, start: np.ndarray, near: np.ndarray
) -> np.ndarray:
    """Controls (T-1, N, m) of a behaviour at weights (N, K) from x_1 (N, n), next to other plans.

    Raises:
        NoPlanError: if none are found.
        ValueError: on an unknown behaviour.
    """
    if behaviour not in BEHAVIOURS:
        raise ValueError(f"unknown behaviour {behaviour!r}; known are: {', '.join(BEHAVIOURS)}")
    if behaviour == "straight":
        return np.zeros_like(near)
    if behaviour == "feedback":
        found = solve_feedback(game, weights, start, initial_controls=near)
        if not found.converged:
            raise NoPlanError("no feedback equilibrium is found")
        return found.controls
    if behaviour == "leading":
        return led_by_first(game, weights, start, near)
    others = alone(game, weights, start, near)
    return others if behaviour == "alone" else answers(game, weights, start, others, near)


def uncoupled(game: Game, share: float) -> Game:
    """The game in which a share of what players mind of the others is gone."""

    def changed(feature: Feature) -> Feature:
        if isinstance(feature, Proximity | CarProximity | Following):
            return replace(feature, scale=(1 - share) * feature.scale)
        return feature

    return replace(game, players=tuple(player.changed(changed) for player in game.players))


def alone(game: Game, weights: np.ndarray, start: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Plans of players that do not mind the others; arguments as of ``plans``."""
    found = iterated_best_response(uncoupled(game, 1.0), weights, start, near, max_rounds=1)
    return found.controls


def answers(
    game: Game, weights: np.ndarray, start: np.ndarray, others: np.ndarray, near: np.ndarray
) -> np.ndarray:
    """Each player's best plan where the others have theirs of ``others``, both (T-1, N, m)."""
    states = rollout(game.dynamics, start, others, game.dt)
    found = [
        response(game, i, near[:, i], states, others, weights) for i in range(game.num_players)
    ]
    return np.stack(found, axis=1)


def response(
    game: Game,
    player: int,
    plan: np.ndarray,
    states: np.ndarray,
    controls: np.ndarray,
    weights: np.ndarray,
) -> np.ndarray:
    """A player's best plan (T-1, m) next to a first one, where the others move as given.

    Raises:
        NoPlanError: if none is found.
    """
    found = best_responses(game, player, plan[None], states, controls, weights)
    if not found.converged[0]:
        raise NoPlanError(f"player {player} finds no response")
    return np.asarray(found.controls[0])


def led_by_first(
    game: Game, weights: np.ndarray, start: np.ndarray, near: np.ndarray
) -> np.ndarray:
    """Plans where the first player leads; arguments as of ``plans``."""
    costs, shape, size = PlanCosts(game, weights, start), near[:, 0].shape, near[:, 0].size
    # In these units the leader's own cost bends the same in all directions.
    values, vectors = bounded(costs.at(near).own_curvatures[:size, :size])
    unit, followed = vectors / np.sqrt(values), near

    def led(away: np.ndarray) -> tuple[float, np.ndarray]:
        """The leader's cost at its plan, and the derivative, the others' answers included."""
        nonlocal followed  # the last answers are near the next ones
        own = near[:, 0] + (unit @ away).reshape(shape)
        followed = _followed(game, weights, start, followed, own)
        at = costs.at(followed)
        bent = at.own_curvatures[size:]
        answer = -np.linalg.solve(bent[:, size:], bent[:, :size])
        slope = at.slopes[0, :size] + at.slopes[0, size:] @ answer
        return at.costs[0], unit.T @ slope

    found = minimize(led, np.zeros(size), jac=True, options={"maxiter": _ITERATIONS, "gtol": 1e-4})
    own = near[:, 0] + (unit @ found.x).reshape(shape)
    return _followed(game, weights, start, followed, own)


def bounded(curvature: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues of a symmetric matrix, none of them too small, and eigenvectors."""
    values, vectors = np.linalg.eigh(curvature)
    return np.maximum(values, _FLATTEST * values[-1]), vectors


def _followed(
    game: Game, weights: np.ndarray, start: np.ndarray, plan: np.ndarray, own: np.ndarray
) -> np.ndarray:
    """Controls (T-1, N, m) in which all others respond to the first player's plan (T-1, m)."""
    controls = plan.copy()
    controls[:, 0] = own
    for _ in range(_ROUNDS):
        before = controls.copy()
        for i in range(1, game.num_players):
            states = rollout(game.dynamics, start, controls, game.dt)
            controls[:, i] = response(game, i, controls[:, i], states, controls, weights)
        if np.abs(controls - before).max() < _SETTLED:
            break
    return controls
