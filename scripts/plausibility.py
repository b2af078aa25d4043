"""How near to the truth honest rows are: none may be marked as implausible.

    python scripts/plausibility.py runs/roads                                     # a run's folder
    python scripts/plausibility.py results/roads/trials.parquet --suite roads     # a table
    python scripts/plausibility.py runs/roads --times 0.2     # of a truth with some noise

All estimators are judged as if they were plugins. Prints how many rows with noise are judged and
marked, and, for a run, the least mean of squared distances over those expected: of one row, and of
a cell of scenario, sensor, noise level and estimator. ``--times`` moves every estimate of a run
towards the truth: its error becomes this part of what it was.
"""

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import shared
import pandas as pd

from olne_bench.bench.judge.truth import true_recording
from olne_bench.bench.plan.draws import draws_of
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.suite import Suite, read_suite_json
from olne_bench.bench.report.statistics.identifiability import weights_of
from olne_bench.bench.report.statistics.plausibility import (
    distances_of,
    implausible,
    places_of,
)
from olne_bench.bench.report.study import Study, study_of
from olne_bench.bench.run.store import read_store
from olne_bench.envs.solved.kept_draws import travelling

LEVEL = ["scenario", "sensor", "estimator", "sigma"]


def main(rows: Path, suite: str | None = None, times: float = 1.0) -> None:
    """Command line."""
    if suite:
        trials, suites = pd.read_parquet(rows), [load_suite(suite)]
    else:
        with read_store(rows) as store:
            trials, suites = store.frame(), [read_suite_json(run.suite) for run in store.runs()]
    study = _as_plugins(suites)
    draws = draws_of(suites[-1].name, suites[-1])
    with travelling(draws) if draws else nullcontext():
        drawn = trials["scenario"].map(study.has_drawn_truths)
        judged = trials[
            drawn & (trials["sigma"] > 0) & trials["status"].isin(["ok", "failed_forward"])
        ]
        if times != 1.0:
            judged = _moved(judged, study, times)
        marked = implausible(judged, study)
        print(f"{marked.sum()} of {len(judged)} rows are marked, of {len(trials)} in all")
        if "weights" in judged and len(judged):
            _say_distances(judged.assign(marked=marked), study)


def _as_plugins(suites: list[Suite]) -> Study:
    study = study_of(suites)
    return replace(
        study,
        estimators={
            label: entry.model_copy(update={"name": f"/{label}.py"})
            for label, entry in study.estimators.items()
        },
    )


def _moved(rows: pd.DataFrame, study: Study, factor: float) -> pd.DataFrame:
    parts = []
    for (scenario, seed), numbers in places_of(rows, ["scenario", "seed"]).items():
        own = rows.iloc[numbers]
        truth = true_recording(study.draw(scenario, int(seed))).scenario.weights
        weights = truth + factor * (weights_of(own, truth.shape) - truth)
        parts.append(own.assign(weights=pd.Series(weights.tolist(), own.index)))
    return pd.concat(parts)


def _say_distances(rows: pd.DataFrame, study: Study) -> None:
    parts = []
    for (scenario, sensor), own in rows.groupby(["scenario", "sensor"]):
        found = distances_of(own, str(scenario), str(sensor), study)
        told = [k for k, one in enumerate(found) if one is not None]
        numbers = [
            (one.whitened, len(one.scales), one.plain, one.scales.sum()) for one in found if one
        ]
        table = pd.DataFrame(numbers, columns=["whitened", "free", "plain", "expected"])
        parts.append(
            pd.concat([own.iloc[told][[*LEVEL, "marked"]].reset_index(drop=True), table], axis=1)
        )
    whole = pd.concat(parts)
    print(f"{len(whole)} of them are looked at with their truth")
    cells = whole.groupby(LEVEL).agg("sum")
    for name, over in (("whitened", "free"), ("plain", "expected")):
        ratio = cells[name] / cells[over]
        print(
            f"{name}: least of one row {(whole[name] / whole[over]).min():.3g}, least of "
            f"{len(cells)} cells {ratio.min():.3g} in {ratio.idxmin()}"
        )
    number = (cells["marked"] == whole.groupby(LEVEL).size()).sum()
    print(f"{number} of {len(cells)} cells are marked as a whole")


if __name__ == "__main__":
    shared.command(main)
