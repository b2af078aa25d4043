"""Continuation from independent players to the coupled game.

Coasting leads Newton's method to a root in only a third to a half of the crossing games. Without
features that depend on other players, each player has an optimal control problem of its own. The
weights of those features then grow to their full values while Newton's method follows the root.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from olne_bench.games.compiled.elimination import Elimination, elimination
from olne_bench.games.compiled.terms import reach
from olne_bench.games.model.constraints import refuse_constraints
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.game import Game
from olne_bench.games.model.numbers import Structure, structure_and_numbers
from olne_bench.games.solve.newton import Root, rows, unpack

#: Smallest step of the coupling strength, which grows from 0 to 1; below it the path is lost.
_SMALLEST_STEP = 1e-3
_LARGEST_STEP = 0.34

#: Intermediate roots only have to stay in the basin of Newton's method.
_LOOSE, _TIGHT = 1e-6, 1e-12


def follow_coupling(
    game: Game,
    weights: np.ndarray,
    initial_state: np.ndarray,
    controls: np.ndarray,
    *,
    max_factorisations: int = 150,
    limit: float = 60.0,
) -> Root | None:
    """Find a root of G by continuation in the coupling between players; None if the path is lost.

    The caller judges its residual. Weights may be (N, K + U); ``limit`` [s] holds for any one
    strength of the coupling. ValueError if the game has constraints (``games.solve.constrained``).
    """
    refuse_constraints(game.constraints, "continuation in the coupling")
    states = rollout(game.dynamics, initial_state, controls, game.dt)
    point = rows(game, states, controls, np.zeros_like(states[1:]))[None]
    path = _Path(elimination(game), weights, coupled_features(game), limit)
    strength, step = 0.0, _LARGEST_STEP
    point, residual, used = path.root_at(0.0, point)
    if not residual < _LOOSE:
        return None
    while strength < 1:
        target = min(1.0, strength + step)
        trial, residual, iterations = path.root_at(target, point)
        used += iterations
        if residual < _LOOSE:
            strength, point = target, trial
            step = min(_LARGEST_STEP, 2 * step)
        else:
            step /= 3
        if step < _SMALLEST_STEP or used > max_factorisations:
            return None
    return Root(*unpack(game, point[0]), residual=residual)


@dataclass(frozen=True)
class _Path:
    """The game with its coupling between players scaled by a strength from 0 to 1."""

    solver: Elimination
    weights: np.ndarray
    coupled: np.ndarray  # (N, K), which weights the strength scales
    limit: float

    def root_at(self, strength: float, point: np.ndarray) -> tuple[np.ndarray, float, int]:
        """Newton's method from a point (1, T, size): last point, max |G| and factorisations."""
        trial = point.copy()
        weights = np.where(self.coupled, strength * self.weights, self.weights)
        residuals, iterations = self.solver.newton(
            trial,
            weights.reshape(1, -1),
            tolerance=_TIGHT if strength == 1 else _LOOSE,
            max_iterations=50 if strength in (0, 1) else 15,
            limit=self.limit,
        )
        return trial, float(residuals[0]), int(iterations[0])


def coupled_features(game: Game) -> np.ndarray:
    """(N, K + U) booleans: whether a preference of a player depends on others; no unknown does."""
    coupled = _coupled_features(structure_and_numbers(game)[0])
    return np.pad(coupled, [(0, 0), (0, game.parameters.count)])


@lru_cache(maxsize=64)
def _coupled_features(structure: Structure) -> np.ndarray:
    count, dynamics = len(structure.players), structure.dynamics
    coupled = [
        [reach(feature, i, count, dynamics) != "own" for feature in player.preferences]
        for i, player in enumerate(structure.players)
    ]
    return np.array(coupled)
