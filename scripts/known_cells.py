"""Regions and posterior means of a run of the suite ``calibration``, cell by cell.

    olne-bench run calibration --out runs/calibration
    python scripts/known_cells.py runs/calibration

A cell is a scenario, a sensor and a noise level. First, whether ``likelihood`` regions of
``kkt_constrained`` hold the truth: the share in each cell, and over all trials, with the exact 95 %
interval. Then the mean cosine error of ``posterior``'s mean, that of the best of its rivals on the
same trials, and their ratio, with the interval of 2,000 bootstrap samples of the trials. An
estimate that says ``not_converged`` counts with the error that it has. The p is that of a one-sided
Wilcoxon test that ``posterior`` is closer to the truth than the maximum likelihood, after Holm's
correction over all cells. Writes both tables to ``--out``.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import shared
import numpy as np
import pandas as pd
from scipy.stats import binomtest, bootstrap, wilcoxon

from olne_bench.bench.report.statistics.pairs import SIGNIFICANCE, holm
from olne_bench.bench.run.store import read_store

FOLDER = Path(__file__).parents[1] / "results" / "calibration"
CELL = ["scenario", "sensor", "sigma"]
MLE = "kkt_constrained"
RIVALS = (MLE, "map", "ridge", "uniform")
SAMPLES = 2000


def main(run: Path, out: Path = FOLDER) -> None:
    """Command line."""
    with read_store(run) as store:
        rows = store.frame()
    covered, gains = pd.DataFrame(_covered(rows)), pd.DataFrame(_gains(rows))
    gains["p_holm"] = holm(gains.pop("p").to_numpy())
    out.mkdir(parents=True, exist_ok=True)
    covered.to_csv(out / "likelihood_regions.csv", index=False)
    gains.to_csv(out / "posterior_gains.csv", index=False)
    for table in (covered, gains):
        print(table.to_string(index=False, float_format=lambda value: f"{value:.3g}"))
    better = gains["p_holm"] < SIGNIFICANCE
    print(
        f"posterior's mean: at most {gains['ratio'].max():.2f} of the best rival's error; better "
        f"than the maximum likelihood in {better.sum()} of {len(better)} cells"
    )


def _covered(rows: pd.DataFrame) -> Iterator[dict[str, Any]]:
    judged = rows[(rows["estimator"] == MLE) & rows["covers_truth"].notna()]
    whole = {"scenario": "all", "sensor": "", "sigma": np.nan}
    cells = [(dict(zip(CELL, cell, strict=True)), own) for cell, own in judged.groupby(CELL)]
    for place, own in [*cells, (whole, judged)]:
        count, number = int(own["covers_truth"].sum()), len(own)
        exact = binomtest(count, number).proportion_ci()
        share = {"covered": count / number, "low": exact.low, "high": exact.high}
        yield place | {"trials": number} | share


def _gains(rows: pd.DataFrame) -> Iterator[dict[str, Any]]:
    wide = rows.pivot_table("cosine_error", [*CELL, "seed"], "estimator")
    wide = wide.dropna(subset=["posterior"])[["posterior", *RIVALS]]
    poor = rows[(rows["estimator"] == "posterior") & (rows["status"] == "not_converged")]
    for cell, own in wide.groupby(level=CELL):
        means = own.mean()
        best = str(means[list(RIVALS)].idxmin())
        interval = bootstrap(
            (own["posterior"].to_numpy(), own[best].to_numpy()),
            lambda a, b, axis: a.mean(axis=axis) / b.mean(axis=axis),
            paired=True,
            vectorized=True,
            n_resamples=SAMPLES,
            method="percentile",
            rng=np.random.default_rng(0),
        ).confidence_interval
        yield dict(zip(CELL, cell, strict=True)) | {
            "trials": len(own),
            "not_converged": int((poor[CELL] == list(cell)).all(axis=1).sum()),
            **means,
            "best": best,
            "ratio": means["posterior"] / means[best],
            "ratio_low": interval.low,
            "ratio_high": interval.high,
            "p": wilcoxon(own["posterior"] - own[MLE], alternative="less").pvalue,
        }


if __name__ == "__main__":
    shared.command(main)
