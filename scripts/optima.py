"""Count how often the joint method finds optima as low as IPOPT's, on the paper's sequences.

    python scripts/optima.py [--out results/perf/optima.parquet] [--every 1]

For each sequence of both scenarios and sensors, it compares the objectives of the joint method as
configured, of the joint method with IPOPT as its solver and three starts (``--reference``, slow),
and of IPOPT on the compact layout with weights started at zero. The rivals' objectives are kept in
the file, so that only ours are computed again. The squared error of the true trajectory is kept as
well: where it differs, the noise was another draw, and the rivals are computed again.
"""

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
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.forward_model import squared_error_of
from olne_bench.estimators.shared.joint_problem import JointPoint
from olne_bench.estimators.shared.trajectory_fit import fit_trajectory

KEY = ["scenario", "sensor", "sigma", "seed"]
RIVALS = ("ipopt", "compact")
TRUTH = "truth_objective"
SAME, NOTHING = 1e-4, 1e-9  # relative and absolute difference of objectives of the same optimum


def main(
    out: Path = Path("results/perf/optima.parquet"), every: int = 1, reference: bool = False
) -> None:
    """Command line."""
    known = _read_kept(out)
    rows = []
    for trial in tqdm(sequences()[::every], disable=None):
        row: dict[str, Any] = dict(zip(KEY, key_of(trial), strict=True))
        row |= {"count": trial.count, TRUTH: _truth(trial), "ours": _joint(trial, "structured")}
        row |= _kept(known.get(key_of(trial)), row[TRUTH])
        if np.isnan(row["compact"]):
            row["compact"] = _compact(trial)
        if np.isnan(row["ipopt"]) and reference:
            row["ipopt"] = _joint(trial, "ipopt")
        rows.append(row)
    table = pd.DataFrame(rows)
    if every == 1:
        out.parent.mkdir(parents=True, exist_ok=True)
        table.to_parquet(out)
    print_shares(table)


def print_shares(table: pd.DataFrame) -> None:
    """Print shares of the study's sequences; each row counts as often as its ``count``."""
    for scenario, rows in table.groupby("scenario"):
        for rival in RIVALS:
            both = rows[rows[rival].notna()]
            if both.empty:
                continue
            margin = SAME * both[rival] + NOTHING
            same_or_lower = np.average(both.ours <= both[rival] + margin, weights=both["count"])
            lower = np.average(both.ours < both[rival] - margin, weights=both["count"])
            print(
                f"{scenario:20s} against {rival:8s} same or lower {same_or_lower:.2%}, "
                f"lower {lower:.2%}, of {len(both)} sequences"
            )


def _read_kept(path: Path) -> dict[Any, dict[Any, Any]]:
    """Rows of an earlier run by sequence; none from a table that does not say of which data."""
    if not path.exists():
        return {}
    table = pd.read_parquet(path)
    if missing := {*KEY, TRUTH, *RIVALS} - set(table.columns):
        print(f"{path} has no column {', '.join(sorted(missing))}: rivals are computed again")
        return {}
    return table.set_index(KEY).to_dict("index")


def _kept(row: dict[Any, Any] | None, truth: float) -> dict[str, float]:
    """The rivals' kept objectives of a sequence; NaN unless they are of the same observation."""
    same = row is not None and np.isclose(row[TRUTH], truth, rtol=1e-6, atol=NOTHING)
    return {rival: row[rival] if row and same else np.nan for rival in RIVALS}


def sequences() -> list[Trial]:
    """One trial for each sequence of the paper's study."""
    found = {key_of(trial): trial for trial in expand(load_suite("paper"))}
    return list(found.values())


def key_of(trial: Trial) -> tuple[str, str, float, int]:
    """The values of ``KEY``."""
    return trial.scenario.label, trial.sensor.label, trial.sigma, trial.seed


def observed(trial: Trial) -> tuple[Problem, Observation]:
    """What an estimator is told of a sequence, and what it sees."""
    case = case_of(trial)
    return case.problem, case.observations[0]


def _truth(trial: Trial) -> float:
    """Squared error of the true trajectory."""
    case = case_of(trial)
    return squared_error_of(case.problem, case.recordings[0].states, case.observations[0].y)


def _joint(trial: Trial, solver: str) -> float:
    """The objective; infinite if the method did not converge."""
    problem, observation = observed(trial)
    estimate = KktConstrained(solver=solver).estimate(
        problem, observation, rng=np.random.default_rng(0), budget=120.0
    )
    return float(estimate.extras["objective"]) if estimate.converged else float("inf")


def _compact(trial: Trial) -> float:
    problem, observation = observed(trial)
    game, view = problem.game, problem.view
    fit = fit_trajectory(game, view, observation.y)
    start = JointPoint.from_trajectory(game, fit.states, fit.controls)
    # Its solver is cached by game and view.
    outcome = CompactLayout(game, view).solve(observation.y, start, problem.weight_floor)
    return outcome.value if outcome.converged else float("inf")


if __name__ == "__main__":
    shared.command(main)
