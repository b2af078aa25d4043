"""Check whether the joint method ended in a worse optimum than a start at the truth.

    python scripts/local_optima.py results/paper --scenario two_player --largest-sigma 0.02

Solves the joint problem of each observation again, started at the true trajectory, costates and
weights, which no estimator knows, and compares objectives. Prints how often that start ends lower,
and by how much.
"""

from pathlib import Path

import shared
import numpy as np
import pandas as pd
from tqdm import tqdm

from olne_bench.bench.judge.trials import case_of
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.trial import KEY_COLUMNS, Trial, expand
from olne_bench.estimators.shared.joint_ipopt import solve_joint_ipopt
from olne_bench.estimators.shared.joint_problem import JointPoint

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


def main(folder: Path, scenario: str = "two_player", largest_sigma: float = 0.02) -> None:
    """Read a run folder and compare."""
    trials = pd.read_parquet(folder / "trials.parquet")
    trials = trials[
        trials["estimator"].eq("kkt_constrained")
        & trials["scenario"].eq(scenario)
        & trials["sigma"].between(0, largest_sigma, inclusive="right")
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
    shared.command(main)
