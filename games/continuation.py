"""Continuation from independent players to the coupled game.

From a coasting trajectory, Newton's method finds a root in only a third to a half of the crossing
games. Without the features that depend on other players, a game separates into one optimal control
problem per player, which Newton's method solves. The weights of those features then grow to their
full values while Newton's method follows the root.
"""

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from olne_bench.games.dynamics import rollout
from olne_bench.games.elimination import Elimination
from olne_bench.games.features import Feature, Stage
from olne_bench.games.game import Game
from olne_bench.games.native import elimination
from olne_bench.games.newton import Root, pack, unpack
from olne_bench.games.observation import View

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
    max_factorisations: int = 400,
    limit: float = 60.0,
    view: View | None = None,
) -> Root | None:
    """Find a root of G by continuation in the coupling between players.

    Args:
        game: the game.
        weights: (N, K).
        initial_state: (N, n).
        controls: (T-1, N, m) first plans.
        max_factorisations: budget of Newton steps.
        limit: wall-clock seconds for any one strength of the coupling.
        view: as of ``games.newton.newton_root``.

    Returns:
        A root, whose residual the caller judges, or None if the path was lost.
    """
    states = rollout(game.dynamics, initial_state, controls, game.dt)
    point = pack(game, states, controls, np.zeros_like(states[1:]))[None]
    path = _Path(elimination(game, view), weights, coupled_features(game), limit)
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


@lru_cache(maxsize=64)
def coupled_features(game: Game) -> np.ndarray:
    """(N, K) booleans: whether this preference of this player depends on other players."""
    return np.array(
        [
            [_is_coupled(game, i, feature) for feature in player.preferences]
            for i, player in enumerate(game.players)
        ]
    )


def _is_coupled(game: Game, player: int, feature: Feature) -> bool:
    states = tuple(ca.SX.sym(f"x{j}", game.dynamics.state_size) for j in range(game.num_players))
    control = ca.SX.sym("u", game.dynamics.control_size)
    others = ca.vertcat(*(x for j, x in enumerate(states) if j != player))
    running = Stage(player, states, control, game.dynamics, game.dt)
    final = Stage(player, states, None, game.dynamics, game.dt)
    cost = ca.SX(feature.running_cost(running)) + feature.final_cost(final)
    return bool(others.numel()) and bool(ca.depends_on(cost, others))
