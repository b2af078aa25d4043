"""Measure the speed of the solvers against IPOPT on the same problems as a whole.

    python scripts/perf.py [--out results/perf] [--sequences 2] [--quick]

Processor time is measured in one process on one core, with our and the rivals' solves in turn.
Other work on the machine slows all of them alike, so the ratios matter, not the milliseconds.
NashOpt is included if it is installed (extra ``peers``). All numbers are in ``perf.json``.
``scripts/optima.py`` checks whether the optima are as good.
"""

import json
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import shared
import numpy as np
from rivals import CompactLayout, Outcome, PublishedLayout, StackedForward

from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.interior_point import solve_joint
from olne_bench.estimators.shared.joint_problem import JointPoint
from olne_bench.estimators.shared.trajectory_fit import fit_trajectory, guess_states
from olne_bench.games.compiled.elimination import elimination
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.observation import VIEWS, observe
from olne_bench.games.solve.batch import solve_batch
from olne_bench.games.solve.newton import Root, newton_root
from olne_bench.games.solve.olne import RESIDUAL_TOLERANCE, Equilibrium, solve_olne

HORIZONS = (25, 50, 100, 200, 400)
PLAYERS = (2, 3, 5, 8, 12)
SIGMAS = (0.005, 0.02, 0.05, 0.1)
FLOOR = 1e-5
RIVALS = ("published", "published, zero", "compact")
Rival = Callable[[np.ndarray, JointPoint, float], Outcome]
SAME = 1e-4  # relative difference of objectives that counts as the same optimum
ROAD_PERIOD = 12.0  # [m] after which the highway's pattern of five cars repeats


def main(out: Path = Path("results/perf"), sequences: int = 2, quick: bool = False) -> None:
    """Measure, write and print."""
    few = 2 if quick else max(len(HORIZONS), len(PLAYERS))
    results: dict[str, Any] = {"inverse": {}, "forward": {}}
    for name in ("two_player", "highway_overtaking"):
        scenario = get_scenario(name)
        truth = solve_olne(scenario.game, scenario.weights, scenario.initial_state)
        results["inverse"][name] = measure_inverse(scenario, truth, sequences)
        results["forward"][name] = measure_forward(scenario, truth)
        print(f"{name} measured", flush=True)
    results["several"] = measure_several(sequences)
    horizon = {
        str(count): [measure_iteration(road(count, steps)) for steps in HORIZONS[:few]]
        for count in (2, 5)
    }
    players = [measure_iteration(road(count, 25)) for count in PLAYERS[:few]]
    slopes = {f"horizon, {count} players": slope(horizon[count], "horizon") for count in horizon}
    results |= {"horizon": horizon, "players": players}
    results["slopes"] = slopes | {"players": slope(players, "players")}
    out.mkdir(parents=True, exist_ok=True)
    (out / "perf.json").write_text(json.dumps(results, indent=1) + "\n")
    print_tables(results)


def measure_several(sequences: int) -> list[dict[str, Any]]:
    """Time estimates of several trajectories against IPOPT: median ratios by their number."""
    scenario, rng = get_scenario("two_player"), np.random.default_rng(0)
    states = solve_olne(scenario.game, scenario.weights, scenario.initial_state).states
    rows = []
    for count in (2, 4, 8):
        ratios, times = [], []
        for view in VIEWS.values():
            problem = Problem(scenario.game, view, SIGMAS[0])
            clean = observe(view, scenario.game.dynamics, states)
            for _ in range(1 + sequences):
                noise = problem.sigma * rng.standard_normal((count, *clean.shape))
                seen = [Observation(clean + one) for one in noise]
                given = problem, seen
                own, ipopt = (
                    milliseconds(partial(one.estimate, *given, rng=rng, budget=60.0))[0]
                    for one in (KktConstrained(), KktConstrained("ipopt"))
                )
                ratios.append(ipopt / own)
                times.append(own)
            del ratios[-1 - sequences], times[-1 - sequences]  # it builds solvers
        rows.append(
            {"trajectories": count, "ms": np.median(times), "median ratio": np.median(ratios)}
        )
    return rows


def milliseconds(solve: Callable[[], Any]) -> tuple[float, Any]:
    """Processor time of one call [ms], and its result."""
    seconds, result = shared.timed(solve)
    return 1e3 * seconds, result


def fastest(solve: Callable[[], Any], times: int) -> tuple[float, Any]:
    """Least processor time of some calls [ms], and its result."""
    return min((milliseconds(solve) for _ in range(times)), key=lambda pair: pair[0])


def measure_inverse(scenario: Scenario, truth: Equilibrium, sequences: int) -> dict[str, Any]:
    """Measure one inverse solve: the estimator with all its starts against single IPOPT solves."""
    rows, game = [], scenario.game
    for view in VIEWS.values():
        estimator, rng = KktConstrained(), np.random.default_rng(0)
        estimator.warm_up(Problem(game, view))
        published, compact = PublishedLayout(game, view), CompactLayout(game, view)
        rivals: dict[str, Rival] = {"published": published.solve, "compact": compact.solve}
        slow: dict[str, Rival] = {"published, zero": partial(published.solve, consistent=False)}
        for k, sigma in enumerate(SIGMAS * sequences):
            y = observe(view, game.dynamics, truth.states)
            y = y + sigma * rng.standard_normal(y.shape)
            raced = rivals if k else rivals | slow
            rows.append(_race(Problem(game, view, sigma), estimator, raced, y))
    table: dict[str, Any] = {"rows": rows, "ours_ms": float(np.median([r["ours"] for r in rows]))}
    for name in RIVALS:
        raced_rows = [row for row in rows if name in row]
        times, ours = (np.array([row[key] for row in raced_rows]) for key in (name, "ours"))
        least = np.array([row[f"{name} objective"] for row in raced_rows])
        own = np.array([row["ours objective"] for row in raced_rows])
        table[name] = {
            "ms": float(np.median(times)),
            "sequences": len(raced_rows),
            "ratio of medians": float(np.median(times) / np.median(ours)),
            "median ratio": float(np.median(times / ours)),
            "ours same or lower": float(np.mean(own <= least * (1 + SAME))),
        }
    return table


def _race(
    problem: Problem, estimator: KktConstrained, rivals: dict[str, Rival], y: np.ndarray
) -> dict[str, Any]:
    """Time all solvers on one sequence; our time includes the pre-solve, the rivals' does not."""
    fit = fit_trajectory(problem.game, problem.view, y)
    start = JointPoint.from_trajectory(problem.game, fit.states, fit.controls)
    rng = np.random.default_rng(0)
    solve = partial(estimator.estimate, problem, Observation(y), rng=rng, budget=60.0)
    own = [milliseconds(solve) for _ in range(3)]
    estimate = own[0][1]
    row: dict[str, Any] = {
        "view": problem.view.name,
        "sigma": problem.sigma,
        "ours": float(np.median([each for each, _ in own])),
        "ours objective": estimate.extras["objective"] if estimate.converged else 1e300,
        "ours starts": estimate.extras["starts"],
    }
    for name, rival in rivals.items():
        row[name], outcome = milliseconds(partial(rival, y, start, FLOOR))
        row[f"{name} objective"] = outcome.value if outcome.converged else 1e300
    return row


def measure_forward(scenario: Scenario, truth: Equilibrium) -> dict[str, float]:
    """Measure a forward game from a solution at nearby weights, and a batch of 1000 weights."""
    game, rng, known = scenario.game, np.random.default_rng(0), scenario.weights
    rival, times = StackedForward(game), []
    motion = truth.states, truth.controls, truth.costates
    for _ in range(20):
        weights = game.check_weights(known * np.exp(0.1 * rng.standard_normal(known.shape)))
        own = partial(newton_root, game, *motion, weights, tolerance=1e-10)
        times.append([fastest(one, 3)[0] for one in (own, partial(rival.solve, truth, weights))])
    ours, theirs = np.array(times).T
    nothing = partial(newton_root, game, *motion, known, max_iterations=0)
    table = {
        "cold, certified, ms": milliseconds(lambda: solve_olne(game, known, truth.states[0]))[0],
        "warm_ms": float(np.median(ours)),
        "ipopt_ms": float(np.median(theirs)),
        "ratio": float(np.median(theirs / ours)),
        "overhead_us": 1e3 * float(np.median([milliseconds(nothing)[0] for _ in range(200)])),
    }
    table |= _nashopt(scenario, truth)
    shape = (1000, *known.shape)
    sets = {"whole simplex": rng.dirichlet(np.ones(shape[2]), size=shape[:2])}
    for spread in (0.2, 0.5):
        sets[f"spread {spread}"] = known * np.exp(spread * rng.standard_normal(shape))
    for name in sorted(sets):
        spent, batch = fastest(partial(solve_batch, game, sets[name], truth, known), 3)
        table[f"batch ms each, {name}"] = spent / shape[0]
        table[f"batch converged, {name}"] = float(batch.converged.mean())
    return table


def _nashopt(scenario: Scenario, truth: Equilibrium) -> dict[str, float]:
    """Measure NashOpt on the forward game: wall-clock time, as it uses threads, of a second run.

    Five players take it minutes, and from coasting it finds no equilibrium.
    """
    if scenario.game.num_players > 2:
        return {}
    try:
        from nashopt_rival import NashOptForward
    except ImportError as error:
        print(f"NashOpt is left out: {error}")
        return {}
    rival = NashOptForward(scenario.game, scenario.weights, scenario.initial_state)
    table = {}
    starts = {"warm": truth.controls + 1e-3, "cold": np.zeros_like(truth.controls)}
    for name, controls in starts.items():
        for _ in range(2):  # the first one compiles
            started = time.perf_counter()
            _, residual = rival.solve(controls)
            table[f"NashOpt {name}, ms"] = 1e3 * (time.perf_counter() - started)
            table[f"NashOpt {name}, residual"] = residual
    return table


def road(players: int, horizon: int) -> Scenario:
    """The highway's five cars, repeated along the road."""
    base = get_scenario("highway_overtaking")
    cars = np.arange(players) % base.game.num_players
    own = tuple(base.game.players[k] for k in cars)
    initial = base.initial_state[cars].copy()
    initial[:, 1] += ROAD_PERIOD * (np.arange(players) // base.game.num_players)
    game = replace(base.game, players=own, horizon=horizon)
    return Scenario("road", game, base.weights[cars], initial)


def road_root(scenario: Scenario) -> Root:
    """A root for any horizon: the root for a shorter one, extended by coasting."""
    game = scenario.game
    if game.horizon <= 25:
        found = solve_olne(game, scenario.weights, scenario.initial_state)
        return Root(found.states, found.controls, found.costates, found.residual)
    head = road_root(replace(scenario, game=replace(game, horizon=max(25, game.horizon - 25))))
    more = game.horizon - 1 - len(head.controls)
    controls, costates = (
        np.concatenate([part, np.zeros((more, *part.shape[1:]))])
        for part in (head.controls, head.costates)
    )
    coasting = rollout(game.dynamics, head.states[-1], controls[-more:], game.dt)
    states = np.concatenate([head.states, coasting[1:]])
    return newton_root(game, states, controls, costates, scenario.weights)


def measure_iteration(scenario: Scenario) -> dict[str, Any]:
    """Measure the time per iteration of an inverse solve: ours, and IPOPT's (compact layout)."""
    game, view = scenario.game, VIEWS["full"]
    root = road_root(scenario)
    if not root.residual < RESIDUAL_TOLERANCE:
        raise SystemExit(f"no root found for {game.num_players} players, T = {game.horizon}")
    y = root.states + 0.01 * np.random.default_rng(0).standard_normal(root.states.shape)
    start = JointPoint.from_trajectory(game, guess_states(game, view, y))
    elimination(game, view)
    ours, solution = fastest(lambda: solve_joint(game, view, y, start), 5)
    table: dict[str, Any] = {
        "ipopt_ms_per_iteration": None,  # where IPOPT would take minutes
        "horizon": game.horizon,
        "players": game.num_players,
        "ours_ms": ours,
        "iterations": solution.iterations,
        "converged": solution.converged,
        "message": solution.message,
        "ours_ms_per_iteration": ours / max(1, solution.iterations),
    }
    if game.horizon * game.num_players <= 300:
        rival = CompactLayout(game, view)
        theirs, outcome = milliseconds(lambda: rival.solve(y, start, FLOOR))
        table["ipopt_ms"] = theirs
        table["ipopt_ms_per_iteration"] = theirs / max(1, outcome.iterations)
    return table


def slope(rows: list[dict[str, Any]], key: str) -> float:
    """Exponent of the time per iteration, by least squares in logarithms."""
    x = np.log([row[key] for row in rows])
    return float(np.polyfit(x, np.log([row["ours_ms_per_iteration"] for row in rows]), 1)[0])


def print_tables(results: dict[str, Any]) -> None:
    """Print all numbers that the project quotes."""
    for name, table in results["inverse"].items():
        print(f"\ninverse, {name}: ours {table['ours_ms']:.2f} ms")
        shared.show({"rival": rival} | table[rival] for rival in RIVALS)
    for name, table in results["forward"].items():
        print(f"\nforward, {name}")
        for key, value in table.items():
            print(f"  {key:34s} {value:10.4g}")
    print("\nseveral trajectories of two players against IPOPT")
    shared.show(results["several"])
    print("\ntime per iteration of an inverse solve")
    for row in [*results["horizon"]["2"], *results["horizon"]["5"], *results["players"]]:
        theirs = row["ipopt_ms_per_iteration"] or np.nan
        print(
            f"  T {row['horizon']:4d}  N {row['players']:3d}"
            f"  ours {row['ours_ms_per_iteration']:8.3f} ms"
            f"  x {row['iterations']:4d}  IPOPT {theirs:8.2f} ms"
            f"  {'converged' if row['converged'] else row['message']}"
        )
    for name, value in results["slopes"].items():
        print(f"  exponent, {name}: {value:.2f}")


if __name__ == "__main__":
    shared.command(main)
