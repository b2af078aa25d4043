"""The forward game solved by NashOpt (extra ``peers``), with exactly this project's costs.

NashOpt needs each player's cost as a JAX function of all decisions: ``examples/nashopt_inverse.py``
makes them.
"""

import runpy
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from olne_bench.games.model.game import Game

EXAMPLE = runpy.run_path(str(Path(__file__).parents[1] / "examples/nashopt_inverse.py"))

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # one of its own dependencies is deprecated
    from nashopt import GNEP


class NashOptForward:
    """One forward game, whose decisions are the controls of all players."""

    def __init__(self, game: Game, weights: np.ndarray, initial_state: np.ndarray) -> None:
        steps, players, controls = game.control_shape
        played = EXAMPLE["JaxGame"](game).played
        first, theta = jnp.asarray(initial_state.ravel()), jnp.asarray(weights.ravel())

        def cost_of(i: int) -> Callable[[Any], Any]:
            return lambda decisions: played(decisions, first, theta)[1][i]

        sizes = [steps * controls] * players
        self.problem = GNEP(sizes, f=[cost_of(i) for i in range(players)])
        self.shape = (players, steps, controls)

    def solve(self, controls: np.ndarray) -> tuple[np.ndarray, float]:
        """Solve from controls (T-1, N, m); return the controls found and their largest residual."""
        start = np.ascontiguousarray(controls.transpose(1, 0, 2)).ravel()
        found = self.problem.solve(start, verbose=0)
        plans = np.asarray(found.x).reshape(self.shape).transpose(1, 0, 2)
        return plans, float(np.abs(np.asarray(found.res)).max())
