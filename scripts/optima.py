"""Whether the joint method finds the best optima, on the sequences of the paper's study.

python scripts/optima.py ipopt [--out results/perf/optima.parquet] [--every 1]
python scripts/optima.py truth results/paper [--scenario two_player] [--largest-sigma 0.02]
python scripts/optima.py starts [--every 1]
"""

import time
from itertools import islice
from pathlib import Path
from typing import Any

import shared
import numpy as np
import pandas as pd
from rivals import CompactLayout
from tqdm import tqdm

from olne_bench.bench.judge.trials import case_of
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.trial import Trial, expand
from olne_bench.estimators.kkt_constrained import KktConstrained, solver_tolerance
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.certainty import likelihood_certainty
from olne_bench.estimators.shared.forward_model import game_of_point, squared_error_of
from olne_bench.estimators.shared.interior_point import joint_elimination
from olne_bench.estimators.shared.joint_ipopt import solve_joint_ipopt
from olne_bench.estimators.shared.joint_problem import JointPoint, JointSettings, JointSolution
from olne_bench.estimators.shared.joint_starts import Search
from olne_bench.estimators.shared.joint_starts import starts as all_starts
from olne_bench.estimators.shared.trajectory_fit import fit_trajectory
from olne_bench.estimators.shared.white_noise import with_white_noise
from olne_bench.games.solve.information import of_weights

KEY = ["scenario", "sensor", "sigma", "seed"]
RIVALS = ("ipopt", "compact")
TRUTH = "truth_objective"
#: Relative and absolute difference of objectives of the same optimum; relative, from the truth.
SAME, NOTHING, SAME_TRUTH = 1e-4, 1e-9, 1e-6
LIMIT = 60.0  # of one search of ``starts`` [s]


def sequences() -> dict[tuple[Any, ...], Trial]:
    """One trial for each sequence of the paper's study, by the values of ``KEY``."""
    return {
        (trial.scenario.label, trial.sensor.label, trial.sigma, trial.seed): trial
        for trial in expand(load_suite("paper"))
    }


def ipopt(
    out: Path = Path("results/perf/optima.parquet"), every: int = 1, reference: bool = False
) -> None:
    """Count how often the joint method finds optima as low as IPOPT's.

    For each sequence of both scenarios and sensors, it compares the objectives of the joint method
    as configured, of the joint method with IPOPT as its solver and three starts (``--reference``,
    slow), and of IPOPT on the compact layout with weights started at zero. The rivals' objectives
    are kept in the file, so that only ours are computed again. The squared error of the true
    trajectory is kept as well: where it differs, the noise was another draw, and the rivals are
    computed again.
    """
    known = _read_kept(out)
    rows = []
    for key, trial in tqdm(list(sequences().items())[::every], disable=None):
        case = case_of(trial)
        problem, seen = case.problem, case.observations[0]
        truth = squared_error_of(problem, case.recordings[0].states, seen.y)
        row: dict[str, Any] = dict(zip(KEY, key, strict=True)) | {"count": trial.count}
        row |= {TRUTH: truth, "ours": _joint(problem, seen, "structured")}
        kept = known.get(key)
        same = kept is not None and np.isclose(kept[TRUTH], truth, rtol=1e-6, atol=NOTHING)
        row |= {rival: kept[rival] if kept and same else np.nan for rival in RIVALS}
        if np.isnan(row["compact"]):
            row["compact"] = _compact(problem, seen)
        if np.isnan(row["ipopt"]) and reference:
            row["ipopt"] = _joint(problem, seen, "ipopt")
        rows.append(row)
    table = pd.DataFrame(rows)
    if every == 1:
        out.parent.mkdir(parents=True, exist_ok=True)
        table.to_parquet(out)
    for scenario, own in table.groupby("scenario"):
        for rival in RIVALS:
            both = own[own[rival].notna()]
            if not both.empty:
                _print_shares(f"{scenario:20s} against {rival:8s}", both, both[rival])


def _print_shares(what: str, rows: pd.DataFrame, rival: pd.Series) -> None:
    """Shares of the study's sequences; each row counts as often as its ``count``."""
    margin = SAME * rival + NOTHING
    same_or_lower = np.average(rows.ours <= rival + margin, weights=rows["count"])
    lower = np.average(rows.ours < rival - margin, weights=rows["count"])
    print(f"{what} same or lower {same_or_lower:.2%}, lower {lower:.2%}, of {len(rows)} sequences")


def _read_kept(path: Path) -> dict[Any, dict[Any, Any]]:
    """Rows of an earlier run by sequence; none from a table that does not say of which data."""
    if not path.exists():
        return {}
    table = pd.read_parquet(path)
    if missing := {*KEY, TRUTH, *RIVALS} - set(table.columns):
        print(f"{path} has no column {', '.join(sorted(missing))}: rivals are computed again")
        return {}
    return table.set_index(KEY).to_dict("index")


def _joint(problem: Problem, seen: Observation, solver: str) -> float:
    """The objective; infinite if the method did not converge."""
    method, rng = KktConstrained(solver=solver), np.random.default_rng(0)
    estimate = method.estimate(problem, seen, rng=rng, budget=120.0)
    return float(estimate.extras["objective"]) if estimate.converged else float("inf")


def _compact(problem: Problem, seen: Observation) -> float:
    game, view = problem.game, problem.view
    fit = fit_trajectory(game, view, seen.y)
    start = JointPoint.from_trajectory(game, fit.states, fit.controls)
    # Its solver is cached by game and view.
    outcome = CompactLayout(game, view).solve(seen.y, start, problem.weight_floor)
    return outcome.value if outcome.converged else float("inf")


def truth(folder: Path, scenario: str = "two_player", largest_sigma: float = 0.02) -> None:
    """Check whether the joint method ended in a worse optimum than a start at the truth.

    Solves the joint problem of each observation of a run folder again, started at the true
    trajectory, costates and weights, which no estimator knows, and compares objectives. Prints how
    often that start ends lower, and by how much.
    """
    trials = pd.read_parquet(folder / "trials.parquet")
    trials = trials[
        trials["estimator"].eq("kkt_constrained")
        & trials["scenario"].eq(scenario)
        & trials["sigma"].between(0, largest_sigma, inclusive="right")
    ]
    known = sequences()
    keys = trials[KEY].itertuples(index=False, name=None)
    least = np.array([_from_truth(known[key]) for key in tqdm(list(keys), disable=None)])
    trials = trials.assign(excess=(trials["objective"] - least) / least)
    for sensor, group in trials.groupby("sensor"):
        worse = group[group["excess"] > SAME_TRUTH]
        print(f"{sensor}: the truth leads lower in {len(worse)} of {len(group)} trials")
        for trial in worse.itertuples():
            print(f"    sigma {trial.sigma:g}, seed {trial.seed}: {trial.excess:.1e} of it")


def _from_truth(trial: Trial) -> float:
    """The objective that a start at the truth leads to; infinite if it does not converge."""
    case = case_of(trial)
    (recording,), (observation,) = case.recordings, case.observations
    weights, problem = recording.scenario.weights, case.problem
    start = JointPoint(recording.states, recording.controls, recording.costates, weights)
    found = solve_joint_ipopt(problem.game, problem.view, [observation.y], [start])
    return found.objective if found.converged else np.inf


def starts(every: int = 1) -> None:
    """What the joint method's further starts find, and whether the first optimum could have told.

    A line per scenario and sensor: sequences, the median iterations of the first and of the second
    start, and on how many sequences a later start ends at a lower optimum. Then, of these, how well
    noise explains the first optimum, and its most certain one: the largest standard deviation of a
    weight over the weight. A rule that skips the second start below this number would lose none of
    them: the share of sequences that it would speed up.
    """
    some = [(key, trial) for key, trial in sequences().items() if trial.sigma > 0][::every]
    rows = [dict(zip(KEY, key, strict=True)) | _searched(one) for key, one in tqdm(some)]
    table = pd.DataFrame(rows)
    for key, own in table.groupby(["scenario", "sensor"]):
        print(
            f"{key[0]!s:20}{key[1]!s:8} {len(own):4} sequences, iterations "
            f"{own['first'].median():.0f} and {own['second'].median():.0f}, "
            f"lower later {int(own['lower'].sum())}"
        )
    for name, own in table.groupby("scenario"):
        lower = own[own["lower"] & np.isfinite(own["deviation"])]
        least = lower["deviation"].min()
        print(
            f"{name!s:20}where a later start ends lower, chi-squared per sample of the first is "
            f"{lower['chi'].median():.2f} in the median; least relative deviation {least:.2g}, "
            f"below which are {100 * np.mean(own['deviation'] < least):.0f} % of the sequences"
        )


def _searched(trial: Trial) -> dict[str, Any]:
    """The starts on one sequence."""
    case = case_of(trial)
    problem, (seen,) = with_white_noise(case.problem, case.observations[0])
    settings = JointSettings(
        noise_scale=problem.noise_scale,
        weight_floor=problem.weight_floor,
        tolerance=solver_tolerance(problem.sigma),
    )
    search = Search.of(problem, seen.y, settings, time.monotonic() + LIMIT)
    some = all_starts(problem, seen.y, search)
    first, second = (search.attempt(*start) for start in islice(some, 2))
    for start in some:
        if search.settled:
            break
        search.attempt(*start)
    least = min(end.criterion for end in search.ends)
    return {
        "first": first.iterations,
        "second": second.iterations,
        "lower": not first.converged or first.criterion > least * (1 + SAME),
        "chi": first.objective / problem.sigma**2 / np.isfinite(seen.y).sum(),
        "deviation": _deviation(problem, seen, first),
    }


def _deviation(problem: Problem, seen: Observation, found: JointSolution) -> float:
    """The largest standard deviation of a weight, over the weight; infinite without an optimum."""
    if not found.converged:
        return np.inf
    games = [game_of_point(found.point)]
    solver = joint_elimination(problem.game, problem.view)
    known = likelihood_certainty(problem, [seen], games, solver)
    covariance = of_weights(problem.game, known.covariance)
    if covariance is None:
        return np.inf
    return float(np.max(np.sqrt(np.diag(covariance)) / games[0].weights.ravel()))


if __name__ == "__main__":
    shared.command(ipopt, truth, starts)
