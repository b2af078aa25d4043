"""Draw one motion with each change of ``docs/misspecified.md``: how far from what is told.

    python scripts/changes_picture.py docs/pictures/changes.png

Three cars at an intersection, ``goal`` with two players. Lines are distances of what is driven from
the equilibrium that estimators are told; where the noise is wrong, dots are those of samples.
"""

from contextlib import suppress
from pathlib import Path

import shared
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from misspecified import CROSSING, IN_TOWN

import olne_bench as ob
from olne_bench.bench.report.figures import style
from olne_bench.envs.changes import CHANGES, wrong_noise
from olne_bench.envs.recordings.recording import record
from olne_bench.envs.scenarios.scenario import Scenario

NOISE = [name for name, own in CHANGES.items() if own.__module__ == wrong_noise.__name__]
SIGMA = 0.5  # [m]
COLUMNS, PANEL = 5, (1.9, 1.45)  # panels beside each other, and their size [inch]
COLOURS = ("#0072B2", "#D55E00", "#009E73")


def main(out: Path) -> None:
    """Draw and write."""
    changes = {name: dials[-1] for name, dials in IN_TOWN.items()}
    changes["goal"] = CROSSING["goal"][-1]
    order = [*(name for name in changes if name not in NOISE), *NOISE]
    with style.applied():
        style.save(picture({name: changes[name] for name in order}), out.with_suffix(""), ["png"])


def picture(changes: dict[str, float]) -> Figure:
    """A panel for each change, at a dial."""
    rows = -(-len(changes) // COLUMNS)
    figure = Figure(figsize=(COLUMNS * PANEL[0], rows * PANEL[1] + 0.4), layout="constrained")
    panels = figure.subplots(rows, COLUMNS).ravel()
    for axes, (name, dial) in zip(panels, changes.items(), strict=False):
        _draw(axes, name, dial)
        axes.set_title(f"{name} {dial:g}", fontsize=8)
    for axes in panels[len(changes) :]:
        axes.axis("off")
    style.entitle(figure, "How far cars are (lines), or seem to be (dots), from what is told [m]")
    figure.supxlabel("Time [s]", fontsize=9)
    return figure


def _draw(axes: Axes, name: str, dial: float) -> None:
    scenario = _playable(name, dial)
    recording = record(scenario)
    driven = recording.states[..., :2]
    told = driven if recording.planned is None else recording.planned[..., :2]
    seen = driven
    if name in NOISE:
        seen = ob.observe(scenario, sigma=SIGMA, seed=0)[1].y[..., :2]
    away = np.linalg.norm(seen - told, axis=-1)
    times = scenario.game.dt * np.arange(len(away))
    for player, colour in enumerate(COLOURS[: away.shape[1]]):
        axes.plot(times, away[:, player], "." if name in NOISE else "-", color=colour, markersize=3)
    axes.set_ylim(bottom=0)
    axes.tick_params(labelsize=7)


def _playable(name: str, dial: float) -> Scenario:
    """The first draw that can be played."""
    roads = name in IN_TOWN
    of = "intersection" if roads else "two_player"
    options = {"num_players": 3, "weights": "temperaments"} if roads else {"weights": "dirichlet"}
    for seed in range(20):
        with suppress(ob.NoEquilibriumError):
            return ob.scenario("changed", seed, of=of, change=name, dial=dial, options=options)
    raise RuntimeError(f"no draw of {of} with {name} {dial:g} can be played")


if __name__ == "__main__":
    shared.command(main)
