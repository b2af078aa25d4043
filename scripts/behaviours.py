"""Who behaves how: the behaviour that made a motion, and the one that explains it best.

    python scripts/behaviours.py drawn [--out results/behaviours] [--draws 12]
    python scripts/behaviours.py recorded DATA [--out results/behaviours]

Motions of each behaviour are drawn by the scenario ``changed`` and seen with noise.
``ob.behaviours`` compares them. A behaviour is chosen where its probability is at least 0.9; else
the motion cannot be told apart. Rows that are there already are
kept, so that the study goes on where it ended. Writes trials.csv, confusion.csv and behaviours.png.

DATA is a folder of CommonRoad files. Of each, the strongest group of at most three cars counts,
with the game ``following`` and unknown noise. Recorded drivers keep to no model to within the
noise, so that residuals are compared, not evidence. Writes people.csv.
"""

from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import shared
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from tqdm import tqdm

import olne_bench as ob
from olne_bench.bench.commands.estimate import recorded_problem
from olne_bench.bench.report.figures import style
from olne_bench.bench.report.figures.confusion import shares_panel
from olne_bench.envs.tracks.explained import explain
from olne_bench.envs.tracks.grid import Excerpt
from olne_bench.envs.tracks.groups import groups_in
from olne_bench.envs.tracks.reading import ANY, grid_and_road, read_tracks
from olne_bench.errors import UserError

ROAD = {"num_players": 3, "weights": "temperaments"}
SCENARIOS = {"intersection": ROAD, "highway": ROAD, "two_player": {"weights": "dirichlet"}}
TRUTHS = ("open_loop", "feedback", "responding", "leading", "alone")
CHOICES = (*TRUTHS, "straight")
UNDECIDED = "undecided"
#: Noise levels [m]; the crossing of two players is a hundred times smaller than roads.
SIGMAS = {
    "intersection": (0.05, 0.2, 0.5),
    "highway": (0.05, 0.2, 0.5),
    "two_player": (0.005, 0.02),
}
SURE = 0.9
#: Cars of a recorded group at most, and the step [s] of its games.
GROUP, STEP = 3, 0.2
KEY = ["scenario", "sigma", "truth", "seed"]


def drawn(out: Path = Path("results/behaviours"), draws: int = 12) -> None:
    """Motions that are drawn: run what is missing, write and print."""
    out.mkdir(parents=True, exist_ok=True)
    path = out / "trials.csv"
    known = pd.read_csv(path).to_dict("records") if path.exists() else []
    rows: list[dict[Any, Any]] = list(known)
    done = {tuple(row[name] for name in KEY) for row in rows}
    missing = [one for one in trials(draws) if one not in done]
    for one in tqdm(missing, unit="motion"):
        row = compared(*one)
        if row is not None:
            rows.append(row)
            pd.DataFrame(rows).sort_values(KEY).round(4).to_csv(path, index=False)
    table = confusion(pd.read_csv(path))
    table.to_csv(out / "confusion.csv", index=False)
    with style.applied():
        style.save(picture(table), out / "behaviours", ["png"])
    shared.show({str(k): v for k, v in row.items()} for row in table.to_dict("records"))


def recorded(data: Path, out: Path = Path("results/behaviours")) -> None:
    """Recorded drivers: residuals [m] of each behaviour."""
    out.mkdir(parents=True, exist_ok=True)
    found = (group_row(path) for path in tqdm(sorted(data.glob("*.xml")), unit="file"))
    rows = pd.DataFrame([row for row in found if row is not None])
    rows.round(3).to_csv(out / "people.csv", index=False)
    lines = [{"behaviour": name, **over_open_loop(rows, name)} for name in CHOICES]
    shared.show({key: str(value) for key, value in line.items()} for line in lines)


def group_row(path: Path) -> dict[str, object] | None:
    """Residuals of the strongest group of a file; None where none can be explained."""
    whole = read_tracks(path, "commonroad", excerpt=Excerpt(None, most=ANY)).recording
    groups = groups_in(*grid_and_road(whole), GROUP)
    if not groups:
        return None
    excerpt = Excerpt(groups[0].window, groups[0].players, STEP)
    try:
        known = read_tracks(path, "commonroad", excerpt=excerpt).recording
        explained = explain("following", None, known, 0, None)
        names, states = known.metadata.state_names, known.states[0]
        problem, y = recorded_problem(explained, names, states, None)
        table = ob.behaviours(problem, ob.Observation(y), CHOICES).set_index("behaviour")
    except (ValueError, UserError) as error:
        print(f"{path.name}: {error}", flush=True)
        return None
    left = {name: float(table["residual"][name]) for name in CHOICES}
    return {"file": path.name, "road": path.name.split("-")[0], "cars": states.shape[1], **left}


def over_open_loop(rows: pd.DataFrame, name: str) -> dict[str, object]:
    """Geometric mean of a behaviour's residuals over those of the open loop, and its interval."""
    ratios = rows[name] / rows["open_loop"]
    logs = np.log(ratios.dropna().to_numpy(float))
    rng = np.random.default_rng(0)
    drawn_means = rng.choice(logs, size=(2000, len(logs))).mean(axis=1)
    low, high = np.exp(np.quantile(drawn_means, (0.025, 0.975)))
    ratio = f"{np.exp(logs.mean()):.2f} [{low:.2f}, {high:.2f}]"
    return {"groups": len(logs), "residual over that of open_loop": ratio}


def trials(draws: int) -> Iterator[tuple[str, float, str, int]]:
    """Scenario, noise level, behaviour and seed of each motion."""
    for scenario in SCENARIOS:
        yield from product([scenario], SIGMAS[scenario], TRUTHS, range(draws))


def compared(scenario: str, sigma: float, truth: str, seed: int) -> dict[str, object] | None:
    """Probabilities of behaviours for one motion; None where there is no such draw."""
    change: dict[str, Any] = (
        {"change": "alone", "dial": 0.0} if truth == "open_loop" else {"change": truth, "dial": 1.0}
    )
    try:
        world = ob.scenario("changed", seed, of=scenario, options=SCENARIOS[scenario], **change)
        problem, seen = ob.observe(world, sigma=sigma, seed=seed)
    except ob.NoEquilibriumError:
        return None
    row: dict[str, object] = dict(zip(KEY, (scenario, sigma, truth, seed), strict=True))
    try:
        found = ob.behaviours(problem, seen, CHOICES).set_index("behaviour")["probability"]
    except ValueError:
        return row | {"chosen": "none", **dict.fromkeys(CHOICES, 0.0)}
    best = str(found.idxmax())
    chosen = best if found[best] >= SURE else UNDECIDED
    return row | {"chosen": chosen, **{name: float(found[name]) for name in CHOICES}}


def confusion(rows: pd.DataFrame) -> pd.DataFrame:
    """How many motions of each behaviour were taken for each, and how many of the choices right."""
    names = [*CHOICES, UNDECIDED, "none"]
    counts = rows.assign(one=1).pivot_table("one", ["scenario", "sigma", "truth"], "chosen", "sum")
    table = (
        counts.reindex(columns=names).fillna(0).astype(int).rename_axis(columns=None).reset_index()
    )
    right = np.array([row[row["truth"]] for _, row in table.iterrows()])
    chosen = table[list(CHOICES)].sum(axis=1)
    table["right"] = np.where(chosen > 0, right / np.maximum(chosen, 1), np.nan).round(3)
    return table


def picture(table: pd.DataFrame) -> Figure:
    """Shares of the motions of each behaviour, at the least noise of each scenario."""
    names = [*CHOICES, UNDECIDED]
    figure, panels = style.grid(
        [f"{name}, {SIGMAS[name][0]:g} m" for name in SCENARIOS], (2.9, 2.6)
    )
    for axes, scenario in zip(panels, SCENARIOS, strict=True):
        own = table[(table["scenario"] == scenario) & (table["sigma"] == SIGMAS[scenario][0])]
        counts = own.set_index("truth").reindex(TRUTHS)[names].fillna(0.0)
        shares_panel(axes, counts.div(counts.sum(axis=1).clip(lower=1), axis=0).to_numpy(float))
        axes.set_xticks(range(len(names)), names, rotation=60)
        axes.set_yticks(range(len(TRUTHS)), TRUTHS)
    style.entitle(figure, "Which behaviour explains a motion: share of the motions of each row [%]")
    figure.supylabel("Behaviour that made it", fontsize=9)
    figure.supxlabel("Behaviour that is chosen", fontsize=9)
    return figure


if __name__ == "__main__":
    shared.command(drawn, recorded)
