"""What the joint method's further starts find, and whether the first optimum could have told.

    python scripts/second_starts.py [--every 1]

On the sequences of the paper's study. A line per scenario and sensor: sequences, the median
iterations of the first and of the second start, and on how many sequences a later start ends at a
lower optimum. Then, of these, how well noise explains the first optimum, and its most certain one:
the largest standard deviation of a weight over the weight. A rule that skips the second start below
this number would lose none of them: the share of sequences that it would speed up.
"""

import time
from itertools import islice
from typing import Any

import shared
import numpy as np
import pandas as pd
from optima import KEY, key_of, observed, sequences
from tqdm import tqdm

from olne_bench.bench.plan.trial import Trial
from olne_bench.estimators.kkt_constrained import solver_tolerance
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.certainty import likelihood_certainty
from olne_bench.estimators.shared.forward_model import SolvedGame
from olne_bench.estimators.shared.interior_point import joint_elimination
from olne_bench.estimators.shared.joint_problem import JointSettings, JointSolution
from olne_bench.estimators.shared.joint_starts import Search, starts
from olne_bench.estimators.shared.white_noise import with_white_noise
from olne_bench.games.solve.information import of_weights
from olne_bench.games.solve.newton import Root

LOWER = 1e-4  # relative difference of objectives that counts as another optimum
LIMIT = 60.0  # of one search [s]


def main(every: int = 1) -> None:
    """Command line."""
    some = [trial for trial in sequences() if trial.sigma > 0][::every]
    table = pd.DataFrame([_row(trial) for trial in tqdm(some, disable=None)])
    for key, rows in table.groupby(["scenario", "sensor"]):
        print(
            f"{key[0]!s:20}{key[1]!s:8} {len(rows):4} sequences, iterations "
            f"{rows['first'].median():.0f} and {rows['second'].median():.0f}, "
            f"lower later {int(rows['lower'].sum())}"
        )
    for name, rows in table.groupby("scenario"):
        lower = rows[rows["lower"] & np.isfinite(rows["deviation"])]
        least = lower["deviation"].min()
        print(
            f"{name!s:20}where a later start ends lower, chi-squared per sample of the first is "
            f"{lower['chi'].median():.2f} in the median; least relative deviation {least:.2g}, "
            f"below which are {100 * np.mean(rows['deviation'] < least):.0f} % of the sequences"
        )


def _row(trial: Trial) -> dict[str, Any]:
    """The starts on one sequence."""
    problem, (seen,) = with_white_noise(*observed(trial))
    settings = JointSettings(
        noise_scale=problem.noise_scale,
        weight_floor=problem.weight_floor,
        tolerance=solver_tolerance(problem.sigma),
    )
    search = Search(problem, seen.y, settings, time.monotonic() + LIMIT)
    some = starts(problem, seen.y, search)
    first, second = (search.attempt(*start) for start in islice(some, 2))
    for start in some:
        if search.settled:
            break
        search.attempt(*start)
    least = min(end.criterion for end in search.ends)
    return dict(zip(KEY, key_of(trial), strict=True)) | {
        "first": first.iterations,
        "second": second.iterations,
        "lower": not first.converged or first.criterion > least * (1 + LOWER),
        "chi": first.objective / problem.sigma**2 / np.isfinite(seen.y).sum(),
        "deviation": _deviation(problem, seen, first),
    }


def _deviation(problem: Problem, seen: Observation, found: JointSolution) -> float:
    """The largest standard deviation of a weight, over the weight; infinite without an optimum."""
    if not found.converged:
        return np.inf
    point = found.point
    root = Root(point.states, point.controls, point.costates, residual=0.0)
    games = [SolvedGame(root, point.weights, point.parameters)]
    solver = joint_elimination(problem.game, problem.view)
    known = likelihood_certainty(problem, [seen], games, solver)
    covariance = of_weights(problem.game, known.covariance)
    if covariance is None:
        return np.inf
    return float(np.max(np.sqrt(np.diag(covariance)) / point.weights.ravel()))


if __name__ == "__main__":
    shared.command(main)
