"""Check whether the joint method ended in a worse optimum than a start at the truth.

    python scripts/local_optima.py results/paper --scenario two_player --largest-sigma 0.02

Solves the joint problem of each observation again, started at the true trajectory, costates and
weights, which no estimator knows, and compares objectives. Prints how often that start ends lower,
and by how much.
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from tqdm import tqdm

from olne_bench.bench.judge.referee import case_of
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.trial import KEY_COLUMNS, Trial, expand
from olne_bench.estimators.joint_ipopt import solve_joint_ipopt
from olne_bench.estimators.joint_problem import JointPoint

#: Objectives with a smaller relative difference are the same optimum.
SAME = 1e-6


def excess(trial: Trial, objective: float) -> float:
    """Relative excess of a trial's objective over the one found from the truth."""
    case = case_of(trial)
    (recording,), (observation,) = case.recordings, case.observations
    weights, problem = recording.scenario.weights, case.problem
    truth = JointPoint(recording.states, recording.controls, recording.costates, weights)
    found = solve_joint_ipopt(problem.game, problem.view, [observation.y], [truth])
    if not found.converged:
        return -np.inf
    return (objective - found.objective) / found.objective


def main() -> None:
    """Read a run folder and compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="folder with trials.parquet of suite paper")
    parser.add_argument("--scenario", default="two_player")
    parser.add_argument("--largest-sigma", type=float, default=0.02)
    arguments = parser.parse_args()
    trials = pd.read_parquet(arguments.folder / "trials.parquet")
    trials = trials[
        trials["estimator"].eq("kkt_constrained")
        & trials["scenario"].eq(arguments.scenario)
        & trials["sigma"].between(0, arguments.largest_sigma, inclusive="right")
    ]
    known = {trial.key: trial for trial in expand(load_suite("paper"))}
    keys = trials[list(KEY_COLUMNS)].astype(str).itertuples(index=False, name=None)
    pairs = zip(keys, tqdm(trials["objective"]), strict=True)
    trials = trials.assign(excess=[excess(known[key], objective) for key, objective in pairs])
    for sensor, group in trials.groupby("sensor"):
        worse = group[group["excess"] > SAME]
        print(f"{sensor}: the truth leads lower in {len(worse)} of {len(group)} trials")
        for trial in worse.itertuples():
            print(f"    sigma {trial.sigma:g}, seed {trial.seed}: {trial.excess:.1e} of it")


if __name__ == "__main__":
    main()
