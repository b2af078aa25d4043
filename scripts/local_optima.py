"""Did the joint method end in a worse optimum than one that the truth leads to?

    python scripts/local_optima.py results/paper --scenario two_player --largest-sigma 0.02

Solves the joint problem of each observation once more, started at the true trajectory, costates
and weights, which no estimator has, and compares objectives. Prints how often that start ends
lower, and by how much.
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from tqdm import tqdm

from olne_bench.bench.judge.observe import observe
from olne_bench.bench.judge.truth import true_recording
from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.estimators.joint_ipopt import solve_joint_ipopt
from olne_bench.estimators.joint_problem import JointPoint
from olne_bench.games.observation import VIEWS

#: Objectives nearer than this, relatively, are the same optimum.
SAME = 1e-6


def excess(trial: pd.Series) -> float:
    """How far a trial's objective is above the one found from the truth, relatively."""
    recording = true_recording(ScenarioEntry(name=trial.scenario), trial.seed)
    view, scenario = VIEWS[trial["view"]], recording.scenario
    (observation,) = observe([recording], (view,), trial.sigma, trial.seed)
    truth = JointPoint(recording.states, recording.controls, recording.costates, scenario.weights)
    found = solve_joint_ipopt(scenario.game, view, [observation.y], [truth])
    if not found.converged:
        return -np.inf
    return (trial.objective - found.objective) / found.objective


def main() -> None:
    """Read a run folder and compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="run folder with trials.parquet")
    parser.add_argument("--scenario", default="two_player")
    parser.add_argument("--largest-sigma", type=float, default=0.02)
    arguments = parser.parse_args()
    trials = pd.read_parquet(arguments.folder / "trials.parquet")
    trials = trials[
        trials["estimator"].eq("kkt_constrained")
        & trials["scenario"].eq(arguments.scenario)
        & trials["sigma"].between(0, arguments.largest_sigma, inclusive="right")
    ]
    rows = tqdm(trials.iterrows(), total=len(trials))
    trials = trials.assign(excess=[excess(trial) for _, trial in rows])
    for view, group in trials.groupby("view"):
        worse = group[group["excess"] > SAME]
        print(f"{view}: the truth leads lower in {len(worse)} of {len(group)} trials")
        for trial in worse.itertuples():
            print(f"    sigma {trial.sigma:g}, seed {trial.seed}: {trial.excess:.1e} of it")


if __name__ == "__main__":
    main()
