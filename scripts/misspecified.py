"""What each change of the world costs, and whether anybody notices: the suite ``misspecified``.

    olne-bench run misspecified --out runs/misspecified
    python scripts/misspecified.py table runs/misspecified [--out results/misspecified]
    python scripts/misspecified.py suite > bench/plan/suites/misspecified.toml

Errors are geometric means over draws, over those of the same estimator where the world is as told.
``noticed`` is the share of estimates whose fit test says at 1 % that the model does not fit; where
the world is as told these are false alarms.
"""

from collections.abc import Iterator
from pathlib import Path

import shared
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from scipy.stats import binomtest

from olne_bench.bench.report.figures import style
from olne_bench.bench.report.statistics.attempts import attempts_of
from olne_bench.bench.run.store import read_store
from olne_bench.bench.run.store_table import to_frame
from olne_bench.estimators.protocol import FIT_LEVEL

TRUE = "as told"
#: Dials of changes that any scenario has, and of those that need lanes and metres.
ANYWHERE = {
    "feedback": (0.25, 0.5, 1.0), "responding": (0.25, 0.5, 1.0), "leading": (0.25, 0.5, 1.0),
    "alone": (0.1, 0.3, 1.0), "hidden_cost": (0.1, 0.3, 1.0), "noise_level": (-1.0, 1.0, 2.0),
    "student_noise": (0.2, 0.333, 0.4), "outliers": (0.01, 0.05, 0.1),
    "lagged_noise": (0.3, 0.6, 0.8), "bias": (0.3, 1.0, 2.0), "clock_offset": (0.1, 0.25, 0.5),
}  # fmt: skip
ON_ROADS = ANYWHERE | {
    "replanning": (2.0, 1.0, 0.4), "entropic": (0.001, 0.01, 0.1), "stock": (0.5, 1.0, 1.5),
    "target_speed": (1.0, 3.0, 5.0), "lane_offset": (0.2, 0.5, 1.0),
    "vehicle_length": (0.1, 0.3, 1.0), "wheelbase": (0.05, 0.2, 0.5),
    "unseen_cars": (1.0, 2.0, 3.0),
}  # fmt: skip
CROSSING = ANYWHERE | {
    "replanning": (2.0, 1.0, 0.5), "entropic": (0.0001, 0.001, 0.01),
    "target_speed": (0.05, 0.1, 0.2), "goal": (0.05, 0.1, 0.2),
}  # fmt: skip
KINDS = {
    "behaviour": ("replanning", "feedback", "responding", "leading", "alone", "entropic", "stock"),
    "wrong noise": tuple(list(ANYWHERE)[5:]),
    "wrong model": (
        *("hidden_cost", "target_speed", "goal", "lane_offset"),
        *("vehicle_length", "wheelbase", "unseen_cars"),
    ),
}
COLOURS = {"behaviour": "#0072B2", "wrong model": "#D55E00", "wrong noise": "#5a8f29"}
LINE = 0.09  # height of a label, in log error
ROADS = dict.fromkeys(("highway", "intersection"), 'num_players = 3, weights = "temperaments"')
ROADS["roundabout"] = ROADS["highway"]
HEAD = """# Written by scripts/misspecified.py.
name = "misspecified"
description = "Worlds that are not what estimators are told: twenty changes at three dials each"
sensors = ["full"]
sigmas = [0.2]
seeds = 40
time_limit = 120.0
# As in roads.toml.
root_iterations = 0
estimators = [
    "kkt_constrained", "map", "ridge", "kkt_residual", "ukf", "particle", "posterior", "uniform",
]
scenarios = ["""


def suite() -> None:
    """Print the suite's file."""
    print(HEAD)
    for name, options in ROADS.items():
        _print(name, options, ON_ROADS)
    _print("two_player", 'weights = "dirichlet"', CROSSING, ", sigmas = [0.02]")
    print("]")


def _print(name: str, options: str, changes: dict[str, tuple[float, ...]], more: str = "") -> None:
    cases = [(TRUE, "alone", 0.0)]
    cases += [(f"{change} {d:g}", change, d) for change, dials in changes.items() for d in dials]
    for label, change, dial in cases:
        of = f'of = "{name}", change = "{change}", dial = {dial}, options = {{ {options} }}'
        named = f'name = "changed", label = "{name}, {label}"'
        print(f"    {{ {named}{more}, options = {{ {of} }} }},")


def table(run: Path, out: Path = Path("results/misspecified")) -> None:
    """Write ``changes.csv`` and ``damage.png``, and print the table of ``map``."""
    with read_store(run) as store:
        trials = attempts_of(to_frame(store.table()))
    found = pd.DataFrame(summaries(trials))
    out.mkdir(parents=True, exist_ok=True)
    found.to_csv(out / "changes.csv", index=False, float_format="%.4g")
    with style.applied():
        draw(found, out / "damage")
    shown = found[found["estimator"] == "map"].drop(columns="estimator")
    print(shown.to_string(index=False, float_format="{:.2f}".format))


def summaries(trials: pd.DataFrame) -> Iterator[dict[str, object]]:
    """A row for each scenario, change, dial and estimator."""
    place = trials["scenario"].str.split(", ", n=1, expand=True)
    trials = trials.assign(of=place[0], change=place[1])
    for (of, estimator), own in trials.groupby(["of", "estimator"]):
        true = own[own["change"] == TRUE]
        for change, rows in own.groupby("change"):
            tested = rows["fit_p"].dropna()
            name, _, dial = str(change).rpartition(" ")
            alarms = int((tested < FIT_LEVEL).sum())
            share, low, high = np.nan, np.nan, np.nan
            if len(tested):
                low, high = binomtest(alarms, len(tested)).proportion_ci(method="wilson")
                share = alarms / len(tested)
            yield {
                "of": of, "change": TRUE if change == TRUE else name,
                "dial": 0.0 if change == TRUE else float(dial), "estimator": estimator,
                "trials": len(rows), "failures": int((rows["status"] != "ok").sum()),
                **{f"{e}_ratio": ratio(rows[e], true[e]) for e in ("cosine_error", "ahead_error")},
                "covers_truth": rows["covers_truth"].astype(float).mean(),
                "noticed": share, "noticed_low": low, "noticed_high": high,
            }  # fmt: skip


def ratio(errors: pd.Series, true: pd.Series) -> float:
    """Geometric mean of errors over that of others; NaN where there are none."""
    logs = [np.log(one.dropna().astype(float).clip(lower=1e-9)) for one in (errors, true)]
    return float(np.exp(logs[0].mean() - logs[1].mean())) if all(map(len, logs)) else np.nan


def draw(found: pd.DataFrame, stem: Path) -> None:
    """Damage over what a user can notice: a line for each change, from its least dial on."""
    figure, axes = plt.subplots(figsize=(8.4, 5.6))
    rows = found[(found["estimator"] == "map") & (found["change"] != TRUE)]
    rows = rows.assign(size=rows.groupby(["of", "change"])["dial"].rank())
    mean = rows.groupby(["change", "size"])[["noticed", "ahead_error_ratio"]].mean()
    heights: list[float] = []
    kinds = {name: kind for kind, names in KINDS.items() for name in names}
    for name in rows["change"].unique():
        x, y = mean.loc[name].dropna().to_numpy().T
        axes.plot(x, y, "o-", color=COLOURS[kinds[name]], markersize=4, alpha=0.8)
        side = {"ha": "right", "xytext": (-6, 0)} if x[-1] > 0.5 else {"xytext": (6, 0)}
        place = apart(np.log(y[-1]), heights)
        axes.annotate(
            name.replace("_", " "), (x[-1], y[-1]), textcoords="offset points", va="center",
            xytext=(side["xytext"][0], 60 * (place - np.log(y[-1]))), ha=side.get("ha", "left"),
        )  # fmt: skip
    axes.set(xlim=(-0.03, 1.03), xlabel="estimates whose fit test says that the model does not fit")
    axes.set(yscale="log", ylabel="error 2 s ahead, over that where the world is as told")
    axes.yaxis.set_major_formatter(style.plain)
    axes.axhline(1.0, color="0.5", linewidth=1)
    style.percent(axes.xaxis)
    for kind, colour in COLOURS.items():
        axes.plot([], [], "o-", color=colour, label=kind)
    axes.legend(loc="upper left")
    style.save(figure, stem, ["png"])


def apart(height: float, taken: list[float]) -> float:
    """A height at least a line away from those that are taken, which it joins."""
    while any(abs(height - other) < LINE for other in taken):
        height += LINE / 4
    taken.append(height)
    return height


if __name__ == "__main__":
    shared.command(suite, table)
