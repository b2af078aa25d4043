"""Measure the speed of the solvers against IPOPT on the same problems as a whole.

    python scripts/perf.py [--out results/perf] [--sequences 2] [--quick]

Processor time is measured in one process on one core, with our and the rivals' solves in turn.
Other work on the machine slows all of them alike, so the ratios matter, not the milliseconds.
NashOpt is included if it is installed (extra ``peers``). The results are ``perf.json`` and
``perf.png``. ``scripts/optima.py`` checks whether the optima are as good.
"""

import json
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import shared
import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
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
from olne_bench.games.model.game import Game
from olne_bench.games.model.observation import VIEWS, View, observe
from olne_bench.games.solve.batch import solve_batch
from olne_bench.games.solve.newton import Root, newton_root
from olne_bench.games.solve.olne import RESIDUAL_TOLERANCE, Equilibrium, solve_olne

HORIZONS = (25, 50, 100, 200, 400)
PLAYERS = (2, 3, 5, 8, 12)
SIGMAS = (0.005, 0.02, 0.05, 0.1)
FLOOR = 1e-5
Rival = Callable[[np.ndarray, JointPoint, float], Outcome]
SAME = 1e-4  # relative difference of objectives that counts as the same optimum
ROAD_PERIOD = 12.0  # [m] after which the highway's pattern of five cars repeats


def main(out: Path = Path("results/perf"), sequences: int = 2, quick: bool = False) -> None:
    """Measure, write, print and draw."""
    horizons = HORIZONS[:2] if quick else HORIZONS
    players = PLAYERS[:2] if quick else PLAYERS
    results: dict[str, Any] = {"inverse": {}, "forward": {}}
    for name in ("two_player", "highway_overtaking"):
        scenario = get_scenario(name)
        truth = solve_olne(scenario.game, scenario.weights, scenario.initial_state)
        results["inverse"][name] = measure_inverse(scenario, truth, sequences)
        results["forward"][name] = measure_forward(scenario, truth)
        print(f"{name} measured", flush=True)
    results["horizon"] = {
        str(count): [measure_iteration(road(count, horizon)) for horizon in horizons]
        for count in (2, 5)
    }
    results["players"] = [measure_iteration(road(count, 25)) for count in players]
    results["slopes"] = {
        "horizon, 2 players": slope(results["horizon"]["2"], "horizon"),
        "horizon, 5 players": slope(results["horizon"]["5"], "horizon"),
        "players": slope(results["players"], "players"),
    }
    out.mkdir(parents=True, exist_ok=True)
    (out / "perf.json").write_text(json.dumps(results, indent=1) + "\n")
    print_tables(results)
    draw(results, out / "perf.png")


def milliseconds(solve: Callable[[], Any]) -> tuple[float, Any]:
    """Processor time of one call [ms], and its result."""
    seconds, result = shared.timed(solve)
    return 1e3 * seconds, result


def measure_inverse(scenario: Scenario, truth: Equilibrium, sequences: int) -> dict[str, Any]:
    """Measure one inverse solve: the estimator with all its starts against single IPOPT solves."""
    rows = []
    for view in VIEWS.values():
        game = scenario.game
        estimator = KktConstrained()
        estimator.warm_up(Problem(game, view))
        published, compact = PublishedLayout(game, view), CompactLayout(game, view)
        rng = np.random.default_rng(0)
        for k, sigma in enumerate(SIGMAS * sequences):
            y = observe(view, game.dynamics, truth.states)
            y = y + sigma * rng.standard_normal(y.shape)
            rivals: dict[str, Rival] = {
                "published": published.solve,
                "compact": compact.solve,
            }
            if k == 0:  # slow
                rivals["published, zero"] = partial(published.solve, consistent=False)
            rows.append(_race(Problem(game, view, sigma), estimator, rivals, y))
    table: dict[str, Any] = {"rows": rows, "ours_ms": float(np.median([r["ours"] for r in rows]))}
    for name in ("published", "published, zero", "compact"):
        raced = [row for row in rows if name in row]
        times, ours = (np.array([row[key] for row in raced]) for key in (name, "ours"))
        not_worse = [
            row["ours objective"] <= row[f"{name} objective"] * (1 + SAME) for row in raced
        ]
        table[name] = {
            "ms": float(np.median(times)),
            "sequences": len(raced),
            "ratio of medians": float(np.median(times) / np.median(ours)),
            "median ratio": float(np.median(times / ours)),
            "ours same or lower": float(np.mean(not_worse)),
        }
    return table


def _race(
    problem: Problem,
    estimator: KktConstrained,
    rivals: "dict[str, Rival]",
    y: np.ndarray,
) -> dict[str, Any]:
    """Time all solvers on one sequence; our time includes the pre-solve, the rivals' does not."""
    fit = fit_trajectory(problem.game, problem.view, y)
    start = JointPoint.from_trajectory(problem.game, fit.states, fit.controls)
    rng = np.random.default_rng(0)
    own = [
        milliseconds(lambda: estimator.estimate(problem, Observation(y), rng=rng, budget=60.0))
        for _ in range(3)
    ]
    estimate = own[0][1]
    row: dict[str, Any] = {
        "view": problem.view.name,
        "sigma": problem.sigma,
        "ours": float(np.median([each for each, _ in own])),
        "ours objective": _objective(estimate.extras["objective"], estimate.converged),
        "ours starts": estimate.extras["starts"],
    }
    for name, solve in rivals.items():
        row[name], outcome = milliseconds(partial(solve, y, start, FLOOR))
        row[f"{name} objective"] = _objective(outcome.value, outcome.converged)
    return row


def _objective(value: float, converged: bool) -> float:
    return value if converged else 1e300


def measure_forward(scenario: Scenario, truth: Equilibrium) -> dict[str, float]:
    """Measure a forward game from a solution at nearby weights, and a batch of 1000 weights."""
    game, rng = scenario.game, np.random.default_rng(0)
    rival = StackedForward(game)
    ratios, ours, theirs = [], [], []
    for _ in range(20):
        weights = scenario.weights * np.exp(0.1 * rng.standard_normal(scenario.weights.shape))
        weights = game.check_weights(weights)
        warm = (game, truth.states, truth.controls, truth.costates, weights)
        both = partial(newton_root, *warm, tolerance=1e-10), partial(rival.solve, truth, weights)
        fast, slow = (min(milliseconds(one)[0] for _ in range(3)) for one in both)
        ours.append(fast)
        theirs.append(slow)
        ratios.append(slow / fast)
    cold, _ = milliseconds(lambda: solve_olne(game, scenario.weights, scenario.initial_state))
    table = {
        "cold, certified, ms": cold,
        "warm_ms": float(np.median(ours)),
        "ipopt_ms": float(np.median(theirs)),
        "ratio": float(np.median(ratios)),
        "overhead_us": _overhead(truth, scenario),
    }
    table |= _nashopt(scenario, truth)
    shape = (1000, *scenario.weights.shape)
    wide = rng.dirichlet(np.ones(shape[2]), size=shape[:2])
    for spread in (0.2, 0.5):
        weights = scenario.weights * np.exp(spread * rng.standard_normal(shape))
        table |= _batch(f"spread {spread}", scenario, truth, weights)
    return table | _batch("whole simplex", scenario, truth, wide)


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


def _batch(
    name: str, scenario: Scenario, truth: Equilibrium, weights: np.ndarray
) -> dict[str, float]:
    runs = [
        milliseconds(lambda: solve_batch(scenario.game, weights, truth, scenario.weights))
        for _ in range(3)
    ]
    batch = runs[0][1]
    return {
        f"batch ms each, {name}": min(each for each, _ in runs) / len(weights),
        f"batch converged, {name}": float(batch.converged.mean()),
    }


def _overhead(truth: Equilibrium, scenario: Scenario) -> float:
    """Time of a call that has nothing to solve [us]."""
    root_start = (scenario.game, truth.states, truth.controls, truth.costates, scenario.weights)
    calls = [
        milliseconds(lambda: newton_root(*root_start, max_iterations=0))[0] for _ in range(200)
    ]
    return 1e3 * float(np.median(calls))


def road(players: int, horizon: int) -> Scenario:
    """The highway's five cars, repeated along the road."""
    base = get_scenario("highway_overtaking")
    count = base.game.num_players
    cars = [base.game.players[k % count] for k in range(players)]
    game: Game = replace(base.game, players=tuple(cars), horizon=horizon)
    initial = base.initial_state[np.arange(players) % count].copy()
    initial[:, 1] += ROAD_PERIOD * (np.arange(players) // count)
    return Scenario("road", game, base.weights[np.arange(players) % count], initial)


def road_root(scenario: Scenario) -> Root:
    """A root for any horizon: the root for a shorter one, extended by coasting."""
    game = scenario.game
    if game.horizon <= 25:
        found = solve_olne(game, scenario.weights, scenario.initial_state)
        return Root(found.states, found.controls, found.costates, found.residual)
    shorter = replace(game, horizon=max(25, game.horizon - 25))
    head = road_root(replace(scenario, game=shorter))
    controls, costates = (
        np.zeros(game.control_shape),
        np.zeros((game.horizon - 1, *head.states.shape[1:])),
    )
    controls[: len(head.controls)] = head.controls
    costates[: len(head.costates)] = head.costates
    coasting = rollout(game.dynamics, head.states[-1], controls[len(head.controls) :], game.dt)
    states = np.concatenate([head.states, coasting[1:]])
    return newton_root(game, states, controls, costates, scenario.weights)


def measure_iteration(scenario: Scenario, view: View = VIEWS["full"]) -> dict[str, Any]:
    """Measure the time per iteration of an inverse solve: ours, and IPOPT's (compact layout)."""
    game = scenario.game
    root = road_root(scenario)
    if not root.residual < RESIDUAL_TOLERANCE:
        raise SystemExit(f"no root found for {game.num_players} players, T = {game.horizon}")
    states = root.states
    rng = np.random.default_rng(0)
    y = states + 0.01 * rng.standard_normal(states.shape)
    start = JointPoint.from_trajectory(game, guess_states(game, view, y))
    elimination(game, view)
    runs = [milliseconds(lambda: solve_joint(game, view, y, start)) for _ in range(5)]
    ours, solution = min(runs, key=lambda pair: pair[0])
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
        for rival in ("published", "published, zero", "compact"):
            row = table[rival]
            print(
                f"  {rival:16s} {row['ms']:10.1f} ms   {row['ratio of medians']:7.1f} x"
                f"   median ratio {row['median ratio']:7.1f} x"
                f"   ours same or lower {row['ours same or lower']:.1%}"
            )
    for name, table in results["forward"].items():
        print(f"\nforward, {name}")
        for key, value in table.items():
            print(f"  {key:34s} {value:10.4g}")
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


def draw(results: dict[str, Any], path: Path) -> None:
    """Time per iteration over the horizon and over the number of players."""
    mpl.use("Agg")
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.6), sharey=True, layout="constrained")
    for count, colour in (("2", "tab:blue"), ("5", "tab:orange")):
        rows, exponent = results["horizon"][count], results["slopes"][f"horizon, {count} players"]
        _line(axes[0], rows, "horizon", colour, f"N = {count}, ours: T$^{{{exponent:.2f}}}$")
    exponent = results["slopes"]["players"]
    _line(axes[1], results["players"], "players", "tab:green", f"ours: N$^{{{exponent:.2f}}}$")
    for axis, label in zip(axes, ("horizon T", "players N (T = 25)"), strict=True):
        axis.set(xscale="log", yscale="log", xlabel=label)
        axis.minorticks_off()
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8)
    axes[0].set_xticks(HORIZONS, [str(t) for t in HORIZONS])
    axes[1].set_xticks(PLAYERS, [str(n) for n in PLAYERS])
    axes[0].set_ylabel("time per iteration [ms]")
    figure.suptitle("Joint inverse problem: interior-point iterations, one core", fontsize=10)
    figure.savefig(path, dpi=110)


def _line(axis: Any, rows: list[dict[str, Any]], key: str, colour: str, label: str) -> None:
    table = pd.DataFrame(rows).set_index(key)
    axis.plot(table["ours_ms_per_iteration"], "o-", color=colour, label=label)
    theirs = table["ipopt_ms_per_iteration"].astype(float).dropna()
    axis.plot(theirs, "x--", color=colour, alpha=0.6, label="IPOPT, compact layout")


if __name__ == "__main__":
    shared.command(main)
