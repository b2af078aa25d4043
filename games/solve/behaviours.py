"""What players do if they do not play the open-loop Nash equilibrium: five other behaviours.

- ``feedback``: each knows how the others would react to it (``feedback``).
- ``responding``: each responds best to others that drive as if they were alone (level one).
- ``leading``: the first player chooses its plan knowing how the others respond to it (Stackelberg).
- ``alone``: nobody minds the others.
- ``straight``: nobody steers or accelerates.
"""

from dataclasses import replace

import numpy as np

from olne_bench.games.model.costs import CarProximity, Feature, Following, Proximity
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.game import Game
from olne_bench.games.solve.best_response import iterated_best_response
from olne_bench.games.solve.feedback import solve_feedback
from olne_bench.games.solve.leading import NoPlanError, led_by_first, response

#: Those that ``plans`` knows.
BEHAVIOURS = ("feedback", "responding", "leading", "alone", "straight")


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
