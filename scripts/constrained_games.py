"""How reliably and how fast are games with hard constraints solved?

python scripts/constrained_games.py merging --draws 50 [--players 4]
python scripts/constrained_games.py roads [--draws 50] [--distance 6]
"""

from typing import Annotated, Any, NamedTuple

import shared
import casadi as ca
import numpy as np

from olne_bench.envs.scenarios.intersection import Intersection
from olne_bench.envs.scenarios.merge import Merge
from olne_bench.envs.scenarios.merging import Merging
from olne_bench.envs.scenarios.scenario import NoEquilibriumError
from olne_bench.games.model.equilibrium import CERTIFICATE_TOLERANCE
from olne_bench.games.solve.constrained import (
    as_root,
    certify_constrained,
    check_start,
    variational_solution,
)
from olne_bench.games.solve.olne import solve_olne

STEPS, DT, DISTANCE = 41, 0.075, 0.16
SAME_COST = 1e-6
BARS = {3: 6.0, 4: 12.0}  # [ms] median of one solution, processor time
LEAST_CERTIFIED = 0.97  # of the games on roads


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


class Row(NamedTuple):
    """One feasible draw: certificate, violation, costs of solver and oracle, their times [s]."""

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


def merging(draws: int = 50, players: Annotated[int, (3, 4)] = 3) -> int:
    """Monte-Carlo starts of ``merging``, beside an oracle that shares no code with the solver.

    As costs look at their own player only, the game has a potential, the sum of all costs: IPOPT
    minimises it under all constraints, from coasting. Both take the same draws in turn, on one
    core; times are processor time. The exit code says whether all bars hold.
    """
    found, drawn = rows(draws, players)
    median, oracle = 1e3 * np.median([row[5:] for row in found], axis=0)
    certified, good = sum(row.certified for row in found), sum(row.as_good for row in found)
    lower = sum(row.cost < row.oracle_cost - SAME_COST for row in found)
    violation = max(row.violation for row in found)
    print(f"feasible    {draws} of {drawn} draws, {players} players")
    print(f"certified   {certified}, largest violation {violation:.1e}")
    print(f"oracle      {sum(np.isfinite(row.oracle_cost) for row in found)} converged")
    print(f"cost        {good} equal or lower, {lower} of them lower by more than {SAME_COST}")
    print(f"median      {median:.2f} ms, IPOPT {oracle:.2f} ms, ratio {oracle / median:.1f}")
    for row in found:
        if not (row.certified and row.as_good):
            print(f"  {row}")
    enough = draws - draws // 1000
    fast = median <= BARS[players] and oracle >= 8 * median
    return 0 if min(certified, good) >= enough and violation <= 1e-8 and fast else 1


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
        given = game, weights, start, np.zeros(game.control_shape)
        if not found:
            variational_solution(*given)  # compiles
        seconds, solution = shared.timed(variational_solution, *given)
        oracle_seconds, (costs, converged) = shared.timed(oracle.solve, start)
        root, _ = as_root(game, solution, weights)
        proof = certify_constrained(game, root, weights, tolerance=CERTIFICATE_TOLERANCE)
        least = float(costs.sum()) if converged else np.inf
        own = seed, proof.passed, proof.violation, float(proof.costs.sum())
        found.append(Row(*own, least, seconds, oracle_seconds))
    return found, seed


def roads(draws: int = 50, distance: float = 6.0) -> int:
    """Games without a potential: two roads, where any two cars have to keep a hard distance.

    Draws at which no motion keeps it from the start on are infeasible, and are counted apart. The
    exit code says whether enough draws are certified.
    """
    total = 0
    for family in (Intersection, Merge):
        plugin = family(distance=distance)
        certified, active, seed, infeasible = 0, 0, 0, 0
        seconds: list[float] = []
        lost: list[int] = []
        while len(seconds) < draws:
            seed += 1
            count = plugin.count(seed)
            scenario = plugin.constrained(np.random.default_rng([seed, count, 0]), count)
            game, start = scenario.game, scenario.initial_state
            try:
                check_start(game, start)
            except ValueError:
                infeasible += 1
                continue
            spent, found = shared.timed(solve_olne, game, scenario.weights, start)
            seconds.append(spent)
            certified += found.certificate.passed
            active += bool(found.active.any())
            lost += [] if found.certificate.passed else [seed]
        total += certified
        print(
            f"{family.name}: {certified} of {draws} certified, {active} with active constraints, "
            f"{infeasible} infeasible; median {np.median(seconds):.2f} s with certificate; "
            f"not certified: seeds {lost}",
            flush=True,
        )
    return 0 if total >= LEAST_CERTIFIED * 2 * draws else 1


if __name__ == "__main__":
    shared.command(merging, roads)
