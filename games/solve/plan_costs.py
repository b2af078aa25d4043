"""Costs of all players as functions of all plans, with first and second derivatives by CasADi."""

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from olne_bench.games.model.game import Game
from olne_bench.games.model.numbers import Structure, structure_and_numbers, with_symbols
from olne_bench.games.model.stage_costs import written_costs


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
        structure, numbers = structure_and_numbers(game)
        self._function = _costs(structure, game.horizon - 1)
        self._known = start.ravel(), np.ravel(weights), numbers.ravel()

    def at(self, controls: np.ndarray) -> CostsAt:
        """The costs of plans (T-1, N, m)."""
        plans = controls.transpose(1, 0, 2).ravel()
        costs, slopes, curvatures = (np.array(v) for v in self._function(plans, *self._known))
        return CostsAt(costs.ravel(), slopes, curvatures)


@lru_cache(maxsize=16)
def _costs(structure: Structure, steps: int) -> ca.Function:
    count, dynamics, each = len(structure.players), structure.dynamics, structure.num_theta
    n, m, own = dynamics.state_size, dynamics.control_size, structure.num_numbers
    x, u = ca.SX.sym("x", count * n), ca.SX.sym("u", count * m)
    theta, numbers = ca.SX.sym("theta", count * each), ca.SX.sym("numbers", count * own)
    rows, moves, dt = ca.vertsplit(x, n), ca.vertsplit(u, m), numbers[0]
    known = zip(structure.players, ca.vertsplit(numbers, own), strict=True)
    players = [with_symbols(player, values[1:]) for player, values in known]
    running, final = written_costs(players, rows, moves, ca.vertsplit(theta, each), dynamics, dt)
    after = [dynamics.step(a, b, dt) for a, b in zip(rows, moves, strict=True)]
    step = ca.Function("step", [x, u, numbers], [ca.vertcat(*after)])
    paid = ca.Function("paid", [x, u, theta, numbers], [ca.vertcat(*running)])
    last = ca.Function("last", [x, theta, numbers], [ca.vertcat(*final)])

    plans = ca.MX.sym("plans", count * steps * m)
    start, weights, given = (ca.MX.sym("known", one.numel()) for one in (x, theta, numbers))
    by_player = [ca.reshape(one, m, steps) for one in ca.vertsplit(plans, steps * m)]
    controls = ca.vertcat(*by_player)
    states = step.mapaccum(steps)(start, controls, ca.repmat(given, 1, steps))
    before = ca.horzcat(start, states[:, :-1])
    each_step = paid.map(steps)(
        before, controls, ca.repmat(weights, 1, steps), ca.repmat(given, 1, steps)
    )
    costs = ca.sum2(each_step) + last(states[:, -1], weights, given)
    slopes = ca.jacobian(costs, plans)
    size = steps * m
    mine = [slopes[i, i * size : (i + 1) * size].T for i in range(count)]
    curvatures = ca.jacobian(ca.vertcat(*mine), plans)
    results = [costs, ca.densify(slopes), ca.densify(curvatures)]
    return ca.Function("costs", [plans, start, weights, given], results)
