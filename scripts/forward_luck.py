"""Measure how much of the published study's failures is luck.

    python scripts/forward_luck.py results/paper
    python scripts/forward_luck.py results/paper --consistent-costates --repeats 1

Repeats the published prediction step (one IPOPT solve, started at the true trajectory) for every
estimate of a run, with the start perturbed by 1e-13 in every state, far below the accuracy of any
estimator or simulator. Prints how many estimates fail in each repeat, how many fail every time and
how many at least once. Costates start at zero, or at values that make the true trajectory
stationary in its states at the estimated weights. Five repeats of two players take about ten
minutes.
"""

from collections import defaultdict
from pathlib import Path

import shared
import numpy as np
import pandas as pd
from tqdm import tqdm

from olne_bench.bench.judge.truth import Draw, true_recording
from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.games.solve.kkt import consistent_costates
from olne_bench.games.solve.nearest_root import nearest_root

PERTURBATION = 1e-13


def failures(trials: pd.DataFrame, scenario: str, repeats: int, consistent: bool) -> pd.DataFrame:
    """Failure counts: one row per estimator and sensor, one column per repeat."""
    recording = true_recording(Draw.of(ScenarioEntry(name=scenario), 0, ""))
    game = recording.scenario.game
    starts = []
    for repeat in range(repeats):
        noise = np.random.default_rng(repeat).standard_normal(recording.states.shape)
        noise[0] = 0  # the initial state is given
        starts.append(recording.states + PERTURBATION * noise)
    rows = trials[trials["scenario"].eq(scenario) & trials["weights"].notna()]
    verdicts: defaultdict[tuple[str, str], list[list[bool]]] = defaultdict(list)
    for row in tqdm(rows.to_dict("records"), desc=scenario):
        weights = game.check_weights(np.stack(row["weights"]))
        costates = np.zeros_like(recording.costates)
        if consistent:
            costates = consistent_costates(game, recording.states, recording.controls, weights)
        failed = [
            nearest_root(game, weights, start, recording.controls, costates) is None
            for start in starts
        ]
        verdicts[row["estimator"], row["sensor"]] += [failed] * row["count"]
    table = {}
    for key, rows_failed in verdicts.items():
        array = np.array(rows_failed)
        counts = {f"repeat {k + 1}": n for k, n in enumerate(array.sum(axis=0))}
        table[key] = {
            "trials": len(array),
            **counts,
            "every time": array.all(axis=1).sum(),
            "at least once": array.any(axis=1).sum(),
        }
    return pd.DataFrame(table).T


def main(
    folder: Path,
    scenario: str = "two_player",
    estimators: tuple[str, ...] = ("kkt_constrained", "kkt_residual"),
    repeats: int = 5,
    consistent_costates: bool = False,
) -> None:
    """Read a run folder and print the table."""
    trials = pd.read_parquet(folder / "trials.parquet")
    trials = trials[trials["estimator"].isin(estimators)]
    table = failures(trials, scenario, repeats, consistent_costates)
    print(table.to_string())


if __name__ == "__main__":
    shared.command(main)
