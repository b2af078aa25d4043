"""Numerical costs of the players in one step of a game, for worlds that go step by step."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import casadi as ca

from olne_bench.games.model.costs import Stage
from olne_bench.games.model.dynamics import Dynamics
from olne_bench.games.model.game import Game, Player


@dataclass(frozen=True)
class StageCosts:
    """The costs of single steps; players are columns."""

    #: ``(states (n, N), controls (m, N), weights (K, N)) -> costs (N,)`` of a step t < T.
    running: ca.Function
    final: ca.Function  # ``(states (n, N), weights (K, N)) -> costs (N,)`` of the last state


@lru_cache(maxsize=64)
def stage_costs(game: Game) -> StageCosts:
    """Build (or fetch) the stage costs of a game."""
    count, dynamics = game.num_players, game.dynamics
    states = ca.SX.sym("x", dynamics.state_size, count)
    controls = ca.SX.sym("u", dynamics.control_size, count)
    weights = ca.SX.sym("theta", game.num_weights, count)
    x, u, theta = (ca.horzsplit(symbol) for symbol in (states, controls, weights))
    running, final = written_costs(game.players, x, u, theta, dynamics, game.dt)
    return StageCosts(
        running=ca.Function(
            "running", [states, controls, weights], [ca.densify(ca.vertcat(*running))]
        ),
        final=ca.Function("final", [states, weights], [ca.densify(ca.vertcat(*final))]),
    )


def written_costs(
    players: Sequence[Player],
    states: Sequence[ca.SX],
    controls: Sequence[ca.SX],
    weights: Sequence[ca.SX],
    dynamics: Dynamics,
    dt: ca.SX | float,
) -> tuple[list[ca.SX], list[ca.SX]]:
    """The costs of a step and of the last state, one of each player, with its own symbols."""
    moving = [Stage(i, tuple(states), own, dynamics, dt) for i, own in enumerate(controls)]
    each = list(zip(players, moving, weights, strict=True))
    return (
        [player.running_cost(stage, own) for player, stage, own in each],
        [player.final_cost(replace(stage, control=None), own) for player, stage, own in each],
    )
