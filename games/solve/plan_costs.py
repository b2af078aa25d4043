"""Costs of all players as functions of all plans, with first and second derivatives."""

from dataclasses import dataclass

import numpy as np

from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.game import Game
from olne_bench.games.solve.expansions import Expansion, Expansions


@dataclass(frozen=True)
class CostsAt:
    """What plans cost; players' plans follow each other, P = (T-1) m controls each.

    Attributes:
        costs: (N,) J^i.
        slopes: (N, N*P) their derivatives.
        own_curvatures: (N*P, N*P) of dJ^i/du^i, stacked: the diagonal has blocks d2J^i/du^i2.
    """

    costs: np.ndarray
    slopes: np.ndarray
    own_curvatures: np.ndarray


class PlanCosts:
    """The costs of a game from a start (N, n), at weights (N, K)."""

    def __init__(self, game: Game, weights: np.ndarray, start: np.ndarray) -> None:
        self._game, self._start = game, start
        self._expansions = Expansions(game, np.asarray(weights, dtype=float))

    def at(self, controls: np.ndarray) -> CostsAt:
        """The costs of plans (T-1, N, m)."""
        game = self._game
        steps, count, m = controls.shape
        states = rollout(game.dynamics, self._start, controls, game.dt)
        found = self._expansions.at(
            states.reshape(len(states), -1), np.ascontiguousarray(controls).reshape(steps, -1)
        )
        costates = _costates(found)
        with_motion = _bent(found, costates, game.dynamics.state_size)
        moved = _moved(found, count, m)  # (T, Nn + Nm, N*P)
        slopes = np.einsum("tip,tpq->iq", found.slopes, moved[:-1])
        states_moved = moved[-1, : found.motion.shape[1]]
        slopes += found.final_slopes @ states_moved
        rows = []
        for i, own in enumerate(np.split(np.arange(count * steps * m), count)):
            bent = with_motion[:, i] @ moved[:-1]
            mine = moved[:-1][..., own].reshape(-1, len(own)).T @ bent.reshape(-1, moved.shape[2])
            last = states_moved[:, own].T @ found.final_squares[i] @ states_moved
            rows.append(mine + last)
        return CostsAt(found.costs, slopes, np.vstack(rows))


def _costates(found: Expansion) -> np.ndarray:
    """(T-1, N, Nn) derivatives of each player's cost to go in the states after each step."""
    states = found.motion.shape[1]
    costates = np.empty((*found.slopes.shape[:2], states))
    costates[-1] = found.final_slopes
    for t in range(len(costates) - 1, 0, -1):
        later = found.slopes[t] + costates[t] @ found.motion[t]
        costates[t - 1] = later[:, :states]
    return costates


def _bent(found: Expansion, costates: np.ndarray, n: int) -> np.ndarray:
    """(T-1, N, Nn + Nm, Nn + Nm): H and what the bends of the motion add to it."""
    count, own = found.bends.shape[1], found.bends.shape[3]
    states, m = count * n, own - n
    inner = np.arange(count)[:, None]
    places = np.hstack([inner * n + np.arange(n), states + inner * m + np.arange(m)])
    weighed = costates.reshape(*costates.shape[:2], count, n)
    bent = found.squares.copy()
    bent[:, :, places[:, :, None], places[:, None, :]] += np.einsum(
        "tijk,tjkab->tijab", weighed, found.bends
    )
    return bent


def _moved(found: Expansion, count: int, m: int) -> np.ndarray:
    """(T, Nn + Nm, N*P): changes of states and controls with all plans; no controls at the end."""
    steps, states, both = found.motion.shape
    moved = np.zeros((steps + 1, both, count * steps * m))
    for t in range(steps):
        for i in range(count):
            for k in range(m):
                moved[t, states + i * m + k, (i * steps + t) * m + k] = 1.0
        moved[t + 1, :states] = found.motion[t] @ moved[t]
    return moved
