"""How much of the error ahead remains if the true weights take the place of an estimate.

    olne-bench run misspecified --out runs/misspecified
    python scripts/truth_ahead.py runs/misspecified

For each world of a run, the medians over draws of the position error 2 s after the last sample [m]:
of each estimator, and of what the game expects at the true weights, ``truth``. Draws that
any of them has no prediction for are left out. Writes ``ahead.csv`` to ``--out``, where worlds that
were not run stay as they are.
"""

from collections.abc import Iterator
from pathlib import Path

import shared
import pandas as pd
from grown_results import grown

import olne_bench as ob
from olne_bench.bench.judge.metrics.ahead_error import AheadError
from olne_bench.bench.judge.truth import Draw, ahead, true_recording
from olne_bench.envs.scenarios.scenario import NoEquilibriumError
from olne_bench.front.studies import StudyRun

SECONDS = 2.0
FEWEST = 30  # draws of a world: others are not finished
METHODS = ("map", "robust", "imperfect", "uniform")
OUT = Path(__file__).parents[1] / "results/misspecified"


def main(runs: tuple[Path, ...], out: Path = OUT) -> None:
    """Command line."""
    found = pd.concat([pd.DataFrame(errors_in(ob.read(run))) for run in runs])
    found = grown(found, out / "ahead.csv", ["scenario"])
    found.to_csv(out / "ahead.csv", index=False, float_format="%.4g")
    print(found.round(3).to_string(index=False))


def errors_in(study: StudyRun) -> Iterator[dict[str, object]]:
    """A row for each world of a run."""
    suite, trials = study.suites[-1], study.trials
    worlds = {one.label: one for one in suite.scenarios}
    chosen = trials[trials["estimator"].isin(METHODS)]
    for label, own in chosen.groupby("scenario", sort=False):
        if own["seed"].nunique() < FEWEST:
            continue
        errors = own.pivot_table(index="seed", columns="estimator", values=f"ahead_{SECONDS:g}s")
        draws = [Draw.of(worlds[str(label)], int(seed), suite.salt) for seed in errors.index]
        errors["truth"] = [of_truth(draw) for draw in draws]
        errors = errors.dropna()
        medians = {str(whose): float(error) for whose, error in errors.median().items()}
        yield {"scenario": str(label), "draws": len(errors), **medians}


def of_truth(draw: Draw) -> float | None:
    """Error [m] of the true weights; None where there is no motion, or no game is found."""
    try:
        found = ahead(draw, true_recording(draw).scenario.theta, SECONDS)
    except NoEquilibriumError:
        return None
    return None if found is None else AheadError().apart(found[0][-1], found[1][-1])


if __name__ == "__main__":
    shared.command(main)
