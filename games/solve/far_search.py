"""Better responses far from an equilibrium, next to which the local certificate of ``olne`` stays.

A player's cost may have other optima: it passes another player on the other side, or waits for it.
One player's best response is computed from first plans that are far apart:

* its response in the game without coupling between the players;
* from that plan and from coasting, each control held at a unit or minus a unit, for the whole time
  or with a change of sign half-way: it turns, swerves, brakes, or slows down and catches up;
* its responses to one other player moved to the left or to the right, so that it passes on the
  other side; from the plan without coupling, and from the equilibrium.

The search is deterministic. ``scripts/certified_draws.py far`` compares it with many random plans.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.game import Game
from olne_bench.games.solve.best_response import best_responses
from olne_bench.games.solve.continuation import coupled_features

#: Newton steps of one response. Responses that are better are found with 15 to 200 alike; most of
#: the time goes into those that are lost off the road.
MOST_STEPS = 30

#: Responses are as exact as certificates need them, which allow gains a hundred times as large.
_TOLERANCE = 1e-9

_respond = partial(best_responses, tolerance=_TOLERANCE, max_iterations=MOST_STEPS)

#: Change of a control by which its effect is measured.
_NUDGE = 1e-6

#: Signs of a control in the two halves of the time.
_HALVES = ((1, 1), (-1, -1), (1, -1), (-1, 1))


@dataclass(frozen=True)
class FarResponses:
    """The best response of each player that was found from far first plans."""

    costs: np.ndarray  # (N,) J^i; infinity if no first plan led to a finite cost
    #: (T-1, N, m); each player's is a response to the others' plans in the equilibrium.
    controls: np.ndarray
    starts: np.ndarray  # (N,) number of first plans


def far_responses(
    game: Game, states: np.ndarray, controls: np.ndarray, weights: np.ndarray
) -> FarResponses:
    """Each player's best response to an equilibrium, from far first plans."""
    costs, best_plans = np.full(game.num_players, np.inf), controls.copy()
    starts = np.zeros(game.num_players, dtype=int)
    for i in range(game.num_players):
        plans = np.concatenate(list(first_plans(game, states, controls, weights, i).values()))
        found = _respond(game, i, plans, states, controls, weights)
        found_costs = np.where(np.isfinite(found.costs), found.costs, np.inf)
        best = int(np.argmin(found_costs))
        costs[i], starts[i] = found_costs[best], len(plans)
        best_plans[:, i] = found.controls[best]
    return FarResponses(costs, best_plans, starts)


def first_plans(
    game: Game, states: np.ndarray, controls: np.ndarray, weights: np.ndarray, player: int
) -> dict[str, np.ndarray]:
    """The first plans (B, T-1, m) of a player in an equilibrium, by what they are."""
    now = controls[:, player]
    uncoupled = np.where(coupled_features(game), 0.0, weights)
    alone = _respond(game, player, now[None], states, controls, uncoupled).controls
    held = _held(len(now), control_units(game, states, controls, player))
    passes = [
        _respond(game, player, np.stack([alone[0], now]), moved, controls, weights).controls
        for moved in _moved_aside(game, states, player, alone[0])
    ]
    return {
        "alone": alone,
        "held, from coasting": held / 2,
        "held, from alone": alone + held,
        "passes": np.concatenate([np.empty((0, *now.shape)), *passes]),
    }


def control_units(game: Game, states: np.ndarray, controls: np.ndarray, player: int) -> np.ndarray:
    """(m,) how much of a held control moves a player by its path's length; 0 if it moves none."""
    first, plan = states[0, [player]], controls[:, [player]]
    path = states[:, player, :2]
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    units = np.zeros(plan.shape[-1])
    for k in range(len(units)):
        nudged = rollout(
            game.dynamics, first, plan + _NUDGE * (np.arange(len(units)) == k), game.dt
        )
        moved = np.linalg.norm(nudged[:, 0, :2] - path, axis=1).max() / _NUDGE
        units[k] = length / moved if moved > 0 else 0.0
    return units


def _held(steps: int, units: np.ndarray) -> np.ndarray:
    """Plans (4 m, T-1, m) that hold one control at a unit in either half of the time."""
    late = np.arange(steps) >= steps // 2
    signs = np.array([np.where(late, second, first) for first, second in _HALVES])
    return np.concatenate([signs[:, :, None] * unit for unit in np.diag(units)])


def _moved_aside(
    game: Game, states: np.ndarray, player: int, alone: np.ndarray
) -> Iterator[np.ndarray]:
    """States (T, N, n) with one other player moved to one side of the player's way past it."""
    first = states[0, [player]]
    way = rollout(game.dynamics, first, alone[:, None], game.dt)[:, 0, :2]
    for j in range(game.num_players):
        if j == player:
            continue
        past = way - states[:, j, :2]
        velocity = np.gradient(past, axis=0)[np.linalg.norm(past, axis=1).argmin()]
        side = np.array([-velocity[1], velocity[0]]) / max(np.linalg.norm(velocity), 1e-9)
        distances = np.linalg.norm(states[:, player, :2] - states[:, j, :2], axis=1)
        # Where both meet, the least distance moves nothing.
        shift = max(distances.min(), np.median(distances) / 4) * side
        for moved in (shift, -shift):
            aside = states.copy()
            aside[:, j, :2] += moved
            yield aside
