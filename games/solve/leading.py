"""Plans of players of whom the first leads: it knows how the others respond (Stackelberg).

Followers respond to the leader and to each other: the slopes of their costs in their own plans
vanish. The leader's cost J then depends on its plan u alone, and its plan is best where

    (L1)  dJ/du + dJ/dv R = 0,    R = dv/du = -(d2J_v/dv2)^-1 d2J_v/dv du,

with followers' plans v and the slopes d2J_v of their own costs, all of them together.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import minimize, root

from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.game import Game
from olne_bench.games.solve.best_response import best_responses
from olne_bench.games.solve.plan_costs import CostsAt, PlanCosts

#: Newton steps of followers, and the change of a plan [control units] that ends them.
_STEPS, _SETTLED = 8, 1e-9
_FARTHEST = 1.0  # change of a plan [control units] at which they do not find each other
#: Rounds in which they respond in turn, where Newton's method ends elsewhere.
_ROUNDS = 30
#: The leader's search, in units in which its own cost bends by 1: iterations, and the slope that
#: ends them, until it is near (L1) and then at it.
_ITERATIONS, _NEAR, _THERE, _MOST = 20, 1e-3, 1e-9, 60
#: Curvature of a cost, relative to the largest, that counts at least.
_FLATTEST = 1e-6


class NoPlanError(Exception):
    """No plans of this behaviour are found."""


def led_by_first(
    game: Game, weights: np.ndarray, start: np.ndarray, near: np.ndarray
) -> np.ndarray:
    """Controls (T-1, N, m) where the first player leads, next to others.

    Weights are (N, K), x_1 (N, n). Raises NoPlanError if a player finds none.
    """
    try:
        return _searched(_Led(game, weights, start, near))
    except np.linalg.LinAlgError as error:
        raise NoPlanError("the leader's or its followers' costs do not bend") from error


def _searched(led: "_Led") -> np.ndarray:
    away = np.zeros(led.size)
    if _largest(led.slope(away)) > _NEAR:
        found = minimize(
            led.cost_and_slope, away, jac=True, options={"maxiter": _ITERATIONS, "gtol": _NEAR}
        )
        away = np.asarray(found.x)
    with np.errstate(invalid="ignore"):  # it divides infinities
        flat = root(
            led.slope,
            away,
            method="broyden1",
            options={"fatol": _THERE, "maxiter": _MOST, "jac_options": {"alpha": -1.0}},
        )
    if flat.success:
        away = np.asarray(flat.x)
    led.slope(away)
    return led.controls


def _largest(numbers: np.ndarray) -> float:
    return float(np.abs(numbers).max())


@dataclass
class _Led:
    """The leader's cost as a function of its plan, followers' answers included."""

    game: Game
    weights: np.ndarray
    start: np.ndarray
    controls: np.ndarray  # (T-1, N, m) of the last answers, which are near the next ones
    size: int = field(init=False)  # of a plan, P

    def __post_init__(self) -> None:
        self._costs = PlanCosts(self.game, self.weights, self.start)
        first = self.controls[:, 0]
        self._shape, self.size, self._first = first.shape, first.size, first.copy()
        values, vectors = bounded(
            self._costs.at(self.controls).own_curvatures[: self.size, : self.size]
        )
        self._unit = vectors / np.sqrt(values)

    def slope(self, away: np.ndarray) -> np.ndarray:
        """(L1) at a plan so far (P,) from the first one."""
        return self.cost_and_slope(away)[1]

    def cost_and_slope(self, away: np.ndarray) -> tuple[float, np.ndarray]:
        """The leader's cost and (L1)."""
        controls = self.controls.copy()
        controls[:, 0] = self._first + (self._unit @ away).reshape(self._shape)
        self.controls, at = self._answered(controls)
        slope = at.slopes[0, : self.size] + at.slopes[0, self.size :] @ self._answer(at)
        return float(at.costs[0]), self._unit.T @ slope

    def _answer(self, at: CostsAt) -> np.ndarray:
        """R of (L1), (followers' plans, P)."""
        bent = at.own_curvatures[self.size :]
        return -np.linalg.solve(bent[:, self.size :], bent[:, : self.size])

    def _answered(self, controls: np.ndarray) -> tuple[np.ndarray, CostsAt]:
        """Controls in which all followers respond to the leader's plan, and what they cost."""
        found = controls
        for _ in range(_STEPS):
            at = self._costs.at(found)
            step = np.linalg.solve(
                at.own_curvatures[self.size :, self.size :], self._own_slopes(at.slopes)
            )
            if not _largest(step) < _FARTHEST:
                break
            if _largest(step) < _SETTLED:
                return found, at
            found = found.copy()
            found[:, 1:] -= step.reshape(-1, *self._shape).swapaxes(0, 1)
        found = self._in_turn(controls)
        return found, self._costs.at(found)

    def _own_slopes(self, slopes: np.ndarray) -> np.ndarray:
        """Each follower's slopes in its own plan, one after the other."""
        count = len(slopes)
        own = slopes.reshape(count, count, self.size)[np.arange(count), np.arange(count)]
        return np.asarray(own[1:].ravel())

    def _in_turn(self, controls: np.ndarray) -> np.ndarray:
        """Followers' responses to the leader and to each other, in turn until they stay."""
        controls = controls.copy()
        for _ in range(_ROUNDS):
            before = controls.copy()
            for i in range(1, self.game.num_players):
                states = rollout(self.game.dynamics, self.start, controls, self.game.dt)
                controls[:, i] = response(
                    self.game, i, controls[:, i], states, controls, self.weights
                )
            if _largest(controls - before) < _SETTLED:
                break
        return controls


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


def bounded(curvature: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues of a symmetric matrix, none of them too small, and eigenvectors."""
    values, vectors = np.linalg.eigh(curvature)
    return np.maximum(values, _FLATTEST * values[-1]), vectors
