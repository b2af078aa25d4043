"""Check whether the error falls as one over the square root of the number of trajectories.

Usage: olne-bench run several --out runs/several
       python scripts/several_trajectories.py runs/several [--out results/several_trajectories]

The error of the weights should fall as 1/sqrt(n). Cosine error is quadratic in it, so the error
here is the root of the mean cosine error over noise draws, compared with the root of its Cramer-Rao
limit. The exponent is the slope of log error over log n, with a percentile bootstrap interval over
noise draws. As a few draws with large errors dominate a mean, the exponent of the root of the
median is given as well. Trials without a valid estimate count as failures and are in no error.
"""

from collections.abc import Callable
from pathlib import Path

import shared
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from olne_bench.bench.plan.suite import read_suite_json
from olne_bench.bench.report.figures.style import (
    FLOOR_COLOUR,
    applied,
    estimator_colours,
    estimator_order,
    save,
)
from olne_bench.bench.report.study import study_of
from olne_bench.bench.run.store import read_store
from olne_bench.bench.run.store_table import to_frame

RESAMPLES = 2000
INTERVAL = (2.5, 97.5)  # percentiles
TICKS = [digit * 10.0**power for power in range(-5, 1) for digit in (1, 2, 5)]


def main(run: Path, out: Path = Path("results/several_trajectories")) -> None:
    """Write ``errors.csv``, ``exponents.csv`` and ``errors.png``, and print the exponents."""
    with read_store(run) as store:
        trials, runs = to_frame(store.table()), store.runs()
    study = study_of(read_suite_json(run.suite) for run in runs)
    entries = trials["scenario"].map(study.scenario)
    trials["trajectories"] = [entry.trajectories for entry in entries]
    trials["scenario"] = [entry.name for entry in entries]
    errors, exponents = [], []
    for key, group in trials.groupby(["scenario", "sensor", "sigma", "estimator"]):
        named = dict(zip(("scenario", "sensor", "sigma", "estimator"), key, strict=True))
        table = squared_errors(group)
        rms, spread = resampled(table, np.nanmean)
        median, median_spread = resampled(table, np.nanmedian)
        limits = np.sqrt(group.groupby("trajectories")["cosine_limit"].first().to_numpy(float))
        counts = np.array(table.columns)
        valid, seconds = table.count().to_numpy(), group.groupby("trajectories")["solve_seconds"]
        for k, n in enumerate(counts):
            low, high = np.percentile(spread[:, k], INTERVAL)
            errors.append(
                named
                | {"trajectories": n, "trials": len(table), "failures": len(table) - valid[k]}
                | {"weight_error": rms[k], "low": low, "high": high}
                | {"weight_error_median": median[k], "limit": limits[k]}
                | {"seconds": seconds.median()[n]}
            )
        row = named | {"limit_exponent": slope(counts, limits)}
        for name, (value, values) in {
            "exponent": (rms, spread),
            "exponent_of_median": (median, median_spread),
        }.items():
            low, high = np.percentile([slope(counts, v) for v in values], INTERVAL)
            row |= {name: slope(counts, value), f"{name}_low": low, f"{name}_high": high}
        row["over_limit"] = float(np.exp(np.mean(np.log(rms / limits))))
        row["failures"] = int(len(table) * len(counts) - valid.sum())
        exponents.append(row)
    out.mkdir(parents=True, exist_ok=True)
    pd.DataFrame(errors).to_csv(out / "errors.csv", index=False, float_format="%.5g")
    pd.DataFrame(exponents).to_csv(out / "exponents.csv", index=False, float_format="%.4g")
    draw(pd.DataFrame(errors), out)
    print(pd.DataFrame(exponents).to_string(index=False, float_format="{:.3g}".format))


def squared_errors(group: pd.DataFrame) -> pd.DataFrame:
    """Cosine errors, one row per seed, one column per number of trajectories; NaN for failures."""
    valid = group["status"].isin(["ok", "failed_forward"])
    errors = group["cosine_error"].where(valid).astype(float)
    return group.assign(error=errors).pivot_table(
        "error", index="seed", columns="trajectories", aggfunc="first", dropna=False
    )


def resampled(
    table: pd.DataFrame, middle: Callable[..., np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Root of a mean or median of squared errors per column, and resamples of it (R, columns).

    Seeds are resampled, so that errors of one draw, which share a trajectory, stay together.
    """
    values, rng = table.to_numpy(), np.random.default_rng(0)
    draws = rng.integers(len(values), size=(RESAMPLES, len(values)))
    return np.sqrt(middle(values, axis=0)), np.sqrt(middle(values[draws], axis=1))


def slope(counts: np.ndarray, errors: np.ndarray) -> float:
    """Exponent of the best-fitting power of n, by least squares in logarithms."""
    return float(np.polyfit(np.log(counts), np.log(errors), 1)[0])


def draw(errors: pd.DataFrame, out: Path) -> None:
    """Draw a panel per sensor and noise level: errors with intervals, the limit, and 1/sqrt(n)."""
    sensors, sigmas = sorted(errors["sensor"].unique()), sorted(errors["sigma"].unique())
    names = estimator_order(list(errors["estimator"]))
    with applied():
        size = 2.6 * len(sigmas), 2.5 * len(sensors) + 0.5
        figure, panels = plt.subplots(
            len(sensors), len(sigmas), figsize=size, sharex=True, sharey=True, squeeze=False
        )
        for axes, (sensor, sigma) in zip(
            panels.flat, ((v, s) for v in sensors for s in sigmas), strict=True
        ):
            part = errors[(errors["sensor"] == sensor) & (errors["sigma"] == sigma)]
            for shift, name in zip(np.linspace(0.94, 1.06, len(names)), names, strict=True):
                own = part[part["estimator"] == name]
                middle = own["weight_error"]
                axes.errorbar(
                    own["trajectories"] * shift,
                    middle,
                    yerr=[middle - own["low"], own["high"] - middle],
                    color=estimator_colours(name)[0],
                    marker="o",
                    markersize=3.5,
                    linewidth=1.2,
                    capsize=2,
                    label=name,
                )
            limit = part[part["estimator"] == names[0]]
            n = limit["trajectories"].to_numpy(float)
            axes.plot(n, limit["limit"], color="black", linestyle="--", label="Cramér-Rao limit")
            ideal = limit["limit"].iloc[0] / np.sqrt(n)
            axes.plot(n, ideal, color=FLOOR_COLOUR, linestyle=":", label="1/√n from its first")
            axes.set(xscale="log", yscale="log", title=f"{sensor}, σ = {sigma:g}")
            axes.set_xticks(n, [f"{value:g}" for value in n])
            ticks = [t for t in TICKS if errors["low"].min() / 1.2 < t < errors["high"].max() * 1.2]
            axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
            axes.minorticks_off()
        for axes in panels[-1]:
            axes.set_xlabel("trajectories n")
        for axes in panels[:, 0]:
            axes.set_ylabel("root mean cosine error")
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
        save(figure, out / "errors", ["png"])
        plt.close(figure)


if __name__ == "__main__":
    shared.command(main)
