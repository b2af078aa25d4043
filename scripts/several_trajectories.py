"""Check whether the error falls as one over the square root of the number of trajectories.

    olne-bench run several --out runs/several
    python scripts/several_trajectories.py runs/several [--out results/several_trajectories]

The error of the weights should fall as 1/sqrt(n). Cosine error is quadratic in it, so the error
here is the root of the mean cosine error over noise draws, compared with the root of its Cramer-Rao
limit. The exponent is the slope of log error over log n, with a percentile bootstrap interval over
noise draws. As a few draws with large errors dominate a mean, the exponent of the root of the
median is given as well. Trials without a valid estimate count as failures and are in no error.
"""

from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import shared
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from olne_bench.bench.plan.suite import read_suite_json
from olne_bench.bench.report.figures import style
from olne_bench.bench.report.study import study_of
from olne_bench.bench.run.store import read_store
from olne_bench.bench.run.store_table import to_frame

KEY = ["scenario", "sensor", "sigma", "estimator"]
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
    valid = trials["status"].isin(["ok", "failed_forward"])
    trials["error"] = trials["cosine_error"].where(valid).astype(float)
    parts = []
    for key, group in trials.groupby(KEY):
        own, exponents = judged(group)
        named = dict(zip(KEY, key, strict=True))
        parts.append((pd.DataFrame(named | own), named | exponents))
    errors = pd.concat([one for one, _ in parts])
    table = pd.DataFrame([one for _, one in parts])
    out.mkdir(parents=True, exist_ok=True)
    errors.to_csv(out / "errors.csv", index=False, float_format="%.5g")
    table.to_csv(out / "exponents.csv", index=False, float_format="%.4g")
    draw(errors, out)
    print(table.to_string(index=False, float_format="{:.3g}".format))


def judged(group: pd.DataFrame) -> tuple[dict[str, object], dict[str, object]]:
    """Of one estimator in one place: errors by number of trajectories, and their exponents."""
    # One row per seed, one column per number of trajectories; NaN for failures.
    table = group.pivot_table("error", "seed", "trajectories", "first", dropna=False)
    by_number, counts = group.groupby("trajectories"), np.array(table.columns)
    limits = np.sqrt(by_number["cosine_limit"].first().to_numpy(float))
    rms, spread = resampled(table, np.nanmean)
    median, median_spread = resampled(table, np.nanmedian)
    low, high = np.percentile(spread, INTERVAL, axis=0)
    failures = len(table) - table.count().to_numpy()
    errors = {
        **{"trajectories": counts, "trials": len(table), "failures": failures},
        **{"weight_error": rms, "low": low, "high": high},
        **{"weight_error_median": median, "limit": limits},
        "seconds": by_number["solve_seconds"].median().to_numpy(),
    }
    row: dict[str, object] = {"limit_exponent": slope(counts, limits)}
    pairs = {"exponent": (rms, spread), "exponent_of_median": (median, median_spread)}
    for name, (value, values) in pairs.items():
        bounds = np.percentile([slope(counts, v) for v in values], INTERVAL)
        row |= {name: slope(counts, value), f"{name}_low": bounds[0], f"{name}_high": bounds[1]}
    row["over_limit"] = float(np.exp(np.mean(np.log(rms / limits))))
    return errors, row | {"failures": int(failures.sum())}


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
    names = style.estimator_order(list(errors["estimator"]))
    shape, size = (len(sensors), len(sigmas)), (2.6 * len(sigmas), 2.5 * len(sensors) + 0.5)
    with style.applied():
        figure, panels = plt.subplots(*shape, figsize=size, sharex=True, sharey=True, squeeze=False)
        for axes, (sensor, sigma) in zip(panels.flat, product(sensors, sigmas), strict=True):
            part = errors[(errors["sensor"] == sensor) & (errors["sigma"] == sigma)]
            panel(axes, part, names)
            axes.set(xscale="log", yscale="log", title=f"{sensor}, σ = {sigma:g}")
            numbers = sorted(part["trajectories"].unique())
            axes.set_xticks(numbers, [f"{value:g}" for value in numbers])
            ticks = [t for t in TICKS if errors["low"].min() / 1.2 < t < errors["high"].max() * 1.2]
            axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
            axes.minorticks_off()
        plt.setp(panels[-1], xlabel="trajectories n")
        plt.setp(panels[:, 0], ylabel="root mean cosine error")
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
        style.save(figure, out / "errors", ["png"])
        plt.close(figure)


def panel(axes: Axes, part: pd.DataFrame, names: list[str]) -> None:
    """Errors of some estimators, with their limit."""
    marks: dict[str, Any] = {"marker": "o", "markersize": 3.5, "linewidth": 1.2, "capsize": 2}
    for shift, name in zip(np.linspace(0.94, 1.06, len(names)), names, strict=True):
        own = part[part["estimator"] == name]
        middle, x = own["weight_error"], own["trajectories"] * shift
        away, colour = [middle - own["low"], own["high"] - middle], style.estimator_colours(name)[0]
        axes.errorbar(x, middle, yerr=away, color=colour, label=name, **marks)
    limit = part[part["estimator"] == names[0]]
    n = limit["trajectories"].to_numpy(float)
    axes.plot(n, limit["limit"], color="black", linestyle="--", label="Cramér-Rao limit")
    ideal = limit["limit"].iloc[0] / np.sqrt(n)
    axes.plot(n, ideal, color=style.FLOOR_COLOUR, linestyle=":", label="1/√n from its first")


if __name__ == "__main__":
    shared.command(main)
