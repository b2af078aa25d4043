"""How reliably and how fast are constrained games solved? Monte-Carlo starts of ``merging``.

python scripts/merging_draws.py --draws 50 [--players 4]

The oracle shares no code with the solver. As costs look at their own player only, the game has a
potential, the sum of all costs: IPOPT minimises it under all constraints, from coasting. Both take
the same draws in turn, on one core; times are processor time.
"""

import time
from dataclasses import dataclass
from typing import Annotated, Any

import shared
import casadi as ca
import numpy as np

from olne_bench.envs.scenarios.merging import Merging
from olne_bench.envs.scenarios.scenario import NoEquilibriumError
from olne_bench.games.model.equilibrium import CERTIFICATE_TOLERANCE
from olne_bench.games.solve.constrained import as_root, certify_constrained, variational_solution

STEPS, DT, DISTANCE = 41, 0.075, 0.16
SAME_COST = 1e-6
BARS = {3: 6.0, 4: 12.0}  # [ms] median of one solution, processor time


class Oracle:
    """The sum of all costs of ``merging``, minimised by IPOPT."""

    def __init__(self, players: int) -> None:
        self.players = players
        states = ca.SX.sym("x", 4 * players, STEPS)
        controls = ca.SX.sym("u", 2 * players, STEPS - 1)
        start = ca.SX.sym("start", 4 * players)
        costs, equations, gaps = [], [states[:, 0] - start], []
        for i in range(players):
            x, u = states[4 * i : 4 * i + 4, :], controls[2 * i : 2 * i + 2, :]
            errors = ca.vertcat(x[1, :] + 0.05, x[2, :], x[3, :] - 0.6)
            running = ca.sumsqr(errors[:, :-1]) + ca.sumsqr(u)
            costs.append(0.5 * 0.1 * DT * running + 0.5 * ca.sumsqr(errors[:, -1]))
            speed, heading = x[3, :-1], x[2, :-1]
            rate = ca.vertcat(speed * ca.cos(heading), speed * ca.sin(heading), u)
            equations.append(ca.vec(x[:, 1:] - x[:, :-1] - DT * rate))
            for j in range(i):
                apart = x[:2, 1:] - states[4 * j : 4 * j + 2, 1:]
                gaps.append(ca.sum1(apart**2).T - DISTANCE**2)
        unknowns = ca.vertcat(ca.vec(states), ca.vec(controls))
        equal, unequal = ca.vertcat(*equations), ca.vertcat(*gaps)
        problem = {"x": unknowns, "p": start, "f": sum(costs), "g": ca.vertcat(equal, unequal)}
        options: dict[str, Any] = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
        self.solver = ca.nlpsol("oracle", "ipopt", problem, options | {"ipopt.tol": 1e-9})
        self.costs = ca.Function("costs", [unknowns], [ca.vertcat(*costs)])
        self.upper = np.concatenate([np.zeros(equal.numel()), np.full(unequal.numel(), np.inf)])

    def solve(self, start: np.ndarray) -> tuple[np.ndarray, bool]:
        """The players' costs (N,) from a start (N, 4), and whether IPOPT converged."""
        states = np.repeat(start[None], STEPS, axis=0)
        along = DT * np.arange(STEPS)[:, None] * start[:, 3]
        states[..., 0] += along * np.cos(start[:, 2])
        states[..., 1] += along * np.sin(start[:, 2])
        guess = np.concatenate([states.ravel(), np.zeros(2 * self.players * (STEPS - 1))])
        solution = self.solver(x0=guess, p=start.ravel(), lbg=0.0, ubg=self.upper)
        success = bool(self.solver.stats()["success"])
        return np.array(self.costs(solution["x"])).ravel(), success


@dataclass(frozen=True)
class Row:
    """One feasible draw: certificate, violation, costs of both and their times [s]."""

    seed: int
    certified: bool
    violation: float
    cost: float
    oracle_cost: float
    seconds: float
    oracle_seconds: float

    @property
    def as_good(self) -> bool:
        """Whether the cost is that of the oracle, or lower."""
        return self.cost <= self.oracle_cost + SAME_COST


def rows(draws: int, players: int) -> tuple[list[Row], int]:
    """The first feasible draws, and how many were drawn for them."""
    oracle, seed = Oracle(players), 0
    found: list[Row] = []
    while len(found) < draws:
        seed += 1
        try:
            scenario = Merging(players).draw(seed)
        except NoEquilibriumError:
            continue
        game, weights, start = scenario.game, scenario.weights, scenario.initial_state
        controls = np.zeros(game.control_shape)
        if not found:
            variational_solution(game, weights, start, controls)  # compiles
        began = time.process_time()
        solution = variational_solution(game, weights, start, controls)
        seconds = time.process_time() - began
        began = time.process_time()
        oracle_costs, converged = oracle.solve(start)
        oracle_seconds = time.process_time() - began
        root, _ = as_root(game, solution, weights)
        proof = certify_constrained(game, root, weights, tolerance=CERTIFICATE_TOLERANCE)
        found.append(
            Row(
                seed,
                proof.passed,
                proof.violation,
                float(proof.costs.sum()),
                float(oracle_costs.sum()) if converged else float("inf"),
                seconds,
                oracle_seconds,
            )
        )
    return found, seed


def main(draws: int = 50, players: Annotated[int, (3, 4)] = 3) -> int:
    """Print the figures; the exit code says whether all bars hold."""
    found, drawn = rows(draws, players)
    median = 1e3 * float(np.median([row.seconds for row in found]))
    oracle = 1e3 * float(np.median([row.oracle_seconds for row in found]))
    certified = sum(row.certified for row in found)
    good = sum(row.as_good for row in found)
    lower = sum(row.cost < row.oracle_cost - SAME_COST for row in found)
    violation = max(row.violation for row in found)
    print(f"feasible    {len(found)} of {drawn} draws, {players} players")
    print(f"certified   {certified}, largest violation {violation:.1e}")
    print(f"oracle      {sum(np.isfinite(row.oracle_cost) for row in found)} converged")
    print(f"cost        {good} equal or lower, {lower} of them lower by more than {SAME_COST}")
    print(f"median      {median:.2f} ms, IPOPT {oracle:.2f} ms, ratio {oracle / median:.1f}")
    for row in found:
        if not (row.certified and row.as_good):
            print(
                f"  seed {row.seed}: certified {row.certified}, "
                f"{row.cost:.6g}, IPOPT {row.oracle_cost:.6g}"
            )
    enough = len(found) - len(found) // 1000
    fast = median <= BARS[players] and oracle >= 8 * median
    return 0 if certified >= enough and good >= enough and violation <= 1e-8 and fast else 1


if __name__ == "__main__":
    shared.command(main)
