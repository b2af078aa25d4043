"""Equilibria that learned estimators are trained on, drawn from the prior of a scenario.

Usage: python scripts/learned_draws.py SCENARIO [--draws N] [--out FILE]

Weights are uniform on the simplex, as the option ``weights = "dirichlet"`` draws them. Starts are
those of the scenario plus normal errors (``posterior_draws``): no other estimator is told the
start, so these must not learn it by heart. The random numbers are those of a stream that no study
uses. Draws without a certified equilibrium, and those beyond the limits of the scenario's world,
are left out and counted. FILE holds ``weights`` (D, N, K) and ``states`` (D, T, N, n).
"""

import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import shared
import numpy as np
from posterior_draws import START_DEVIATIONS
from tqdm import tqdm

from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.envs.scenarios.true_weights import DIRICHLET
from olne_bench.games.solve.olne import solve_olne

#: Distinguishes these random numbers from those of all studies.
_STREAM = 0x6C6561726E

#: How many truths a network is trained on.
DRAWS = {"two_player": 20_000, "highway_overtaking": 10_000}


def main(
    scenario: Annotated[str, sorted(DRAWS)], draws: int | None = None, out: Path | None = None
) -> None:
    """Command line."""
    path = out or Path("runs/learned") / f"{scenario}.npz"
    write_draws(scenario, draws or DRAWS[scenario], path)


def write_draws(name: str, count: int, out: Path) -> None:
    """Draw truths, write those that have an equilibrium, and say what they cost."""
    begin, weights, states = time.process_time(), [], []
    for index in tqdm(range(count), desc="draws", disable=None, leave=False):
        drawn = _drawn(name, index)
        motion = _equilibrium(drawn)
        if motion is not None:
            weights.append(drawn.weights)
            states.append(motion)
    out.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(out, weights=np.array(weights), states=np.array(states))
    seconds = time.process_time() - begin
    print(
        f"{name}: {len(weights)} equilibria of {count} draws, {seconds:.0f} s of processor time",
        flush=True,
    )


def _drawn(name: str, index: int) -> Scenario:
    """The scenario with weights and starts of a draw."""
    scenario, rng = (
        get_scenario(name, 0, weights=DIRICHLET),
        np.random.default_rng([_STREAM, index]),
    )
    players, count = scenario.weights.shape
    start = scenario.initial_state
    start = start + START_DEVIATIONS[name] * rng.standard_normal(start.shape)
    return replace(scenario, weights=rng.dirichlet(np.ones(count), players), initial_state=start)


def _equilibrium(scenario: Scenario) -> np.ndarray | None:
    """States (T, N, n); None without a certified equilibrium that the world can play."""
    found = solve_olne(scenario.game, scenario.weights, scenario.initial_state, search_far=True)
    limits = scenario.limits
    assert limits is not None, "worlds need limits"
    played = (np.abs(found.controls) <= limits.controls).all()
    played &= (np.abs(found.states) <= limits.states).all()
    return found.states if found.certificate.passed and played else None


if __name__ == "__main__":
    shared.command(main)
