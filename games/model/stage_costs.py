"""Numerical costs of the players in one step of a game.

Worlds need them step by step; ``games.solve.kkt.KktSystem.cost_function`` is their sum over an
episode.
"""

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca

from olne_bench.games.model.costs import Stage
from olne_bench.games.model.game import Game


@dataclass(frozen=True)
class StageCosts:
    """The costs of single steps; players are columns.

    Attributes:
        running: ``(states (n, N), controls (m, N), weights (K, N)) -> costs (N,)`` of a step t < T.
        final: ``(states (n, N), weights (K, N)) -> costs (N,)`` of the last state.
    """

    running: ca.Function
    final: ca.Function


@lru_cache(maxsize=64)
def stage_costs(game: Game) -> StageCosts:
    """Build (or fetch) the stage costs of a game."""
    count, dynamics = game.num_players, game.dynamics
    states = ca.SX.sym("x", dynamics.state_size, count)
    controls = ca.SX.sym("u", dynamics.control_size, count)
    weights = ca.SX.sym("theta", game.num_weights, count)
    rows = tuple(ca.horzsplit(states))

    running, final = [], []
    for i, player in enumerate(game.players):
        moving = Stage(i, rows, controls[:, i], dynamics, game.dt)
        resting = Stage(i, rows, None, dynamics, game.dt)
        running.append(player.running_cost(moving, weights[:, i]))
        final.append(player.final_cost(resting, weights[:, i]))
    return StageCosts(
        running=ca.Function(
            "running", [states, controls, weights], [ca.densify(ca.vertcat(*running))]
        ),
        final=ca.Function("final", [states, weights], [ca.densify(ca.vertcat(*final))]),
    )
