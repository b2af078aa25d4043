"""One trial on a road: truth, what was seen, and what two estimators predict."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from olne_bench.bench.judge.metrics.declaration import declare
from olne_bench.bench.judge.metrics.position_error import PositionError
from olne_bench.bench.report.figures import style
from olne_bench.bench.report.figures.panels import scene_panels
from olne_bench.bench.report.figures.scene import Scene, scene_of
from olne_bench.bench.report.figures.series import sensors_in
from olne_bench.bench.report.figures.trajectories import draw_bundle, draw_truth, legend_entries
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.statistics.attempts import FLOOR, attempts_of, errors_of, measured
from olne_bench.bench.report.statistics.wins import win_counts, win_table
from olne_bench.bench.report.study import USUAL, Study
from olne_bench.envs.worlds.scene import player_colour

_METRIC = declare(PositionError)
_ENOUGH = 0.5  # share of the draws that both must predict
_TRIES = 5  # trials whose predictions are searched again
_TRIAL = ["sensor", "sigma", "seed"]


@dataclass(frozen=True)
class Choice:
    """Trials that may be shown, all with the same estimators, sensor and noise.

    Attributes:
        estimators: labels of the two.
        sensor: label of the sensor.
        sigma: noise level [m].
        seeds: draws, the one whose difference of errors is nearest to the median first.
        rule: how it was chosen, in words.
    """

    estimators: tuple[str, str]
    sensor: str
    sigma: float
    seeds: tuple[int, ...]
    rule: str


def is_road(label: str, study: Study) -> bool:
    """Whether HighwayEnv plays the scenario with this label."""
    from olne_bench.envs.roads.highway_roads import ROAD_NAMES  # HighwayEnv is slow to import

    entry = study.scenarios.get(label)
    return entry is not None and entry.name in ROAD_NAMES


def draw(trials: pd.DataFrame, study: Study = USUAL) -> Figure:
    """Truth and observations of one trial, then the predictions of two estimators.

    The trial follows from the data by a rule (``choose``), which the title says.

    Raises:
        NotDrawnError: as ``choose`` and ``scene_of``, and if no prediction is found again.
    """
    attempts = attempts_of(trials)
    choice = choose(attempts, study)
    for seed, scene in _scenes(attempts, choice, study):
        told = [_row(scene, choice, seed, name) for name in choice.estimators]
        found = [scene.predicted(row) for row in told]
        if all(states is not None for states in found):
            break
    else:
        raise NotDrawnError("the predictions of the chosen trials are not found again")
    scene = scene.showing(*(states for states in found if states is not None))
    places = [(k, 0) if scene.is_wide else (0, k) for k in range(3)]
    figure, panels = scene_panels(scene, places, margin=(0.3, 1.1))
    draw_bundle(
        panels[0],
        scene,
        scene.observed(choice.sigma, seed),
        marker=".",
        markersize=4,
        linestyle="none",
    )
    panels[0].set_title("Truth and what was seen")
    for axes, row, states in zip(panels[1:], told, found, strict=True):
        _prediction(axes, scene, row, states)
    for axes in panels:
        draw_truth(axes, scene)
    figure.suptitle(
        f"{scene.name}, draw {seed}: σ = {choice.sigma:g} m, sensor {choice.sensor}"
        f"{scene.stretch_note}\n{choice.rule}",
        fontsize=9,
    )
    style.legend_below(figure, [*legend_entries(scene), *_ends()])
    return figure


def choose(attempts: pd.DataFrame, study: Study = USUAL) -> Choice:
    """Choose the trial to show.

    The first estimator has the least median position error of all contenders. The second one is the
    contender from which it wins the largest share of draws; of equal ones, that with the most
    predictions. The noise is the largest at which both predict at least half of the draws, with the
    first sensor for which they do. Of the draws with both predictions, the one whose difference of
    errors is nearest to the median comes first.

    Args:
        attempts: attempts on one scenario.
        study: study of the run.

    Raises:
        NotDrawnError: if there are no two estimators, or no trial with predictions of both.
    """
    first, second = _estimators(attempts, study)
    pairs = _pairs(attempts, first, second)
    shares = pairs.groupby(["sensor", "sigma"])["drawn"].mean()
    if not (shares > 0).any():
        raise NotDrawnError(f"{first} and {second} predict no trial in common")
    enough = shares[shares >= min(_ENOUGH, shares.max())]
    order = sensors_in(attempts)
    sensor, sigma = max(enough.index, key=lambda cell: (cell[1], -order.index(cell[0])))
    here = pairs[(pairs["sensor"] == sensor) & (pairs["sigma"] == sigma) & pairs["drawn"]]
    seeds = here.sort_values(["gap", "seed"])["seed"].to_numpy(int)
    middle = np.argsort(np.abs(np.arange(len(seeds)) - (len(seeds) - 1) // 2), kind="stable")
    number = int(((pairs["sensor"] == sensor) & (pairs["sigma"] == sigma)).sum())
    rule = (
        f"{first} and {second} predict {len(seeds)} of {number} draws; "
        "this one has the median difference of errors"
    )
    return Choice((first, second), str(sensor), float(sigma), tuple(seeds[middle].tolist()), rule)


def _estimators(attempts: pd.DataFrame, study: Study) -> tuple[str, str]:
    if _METRIC.name not in attempts:
        raise NotDrawnError("there is no position error")
    told = attempts[measured(attempts, _METRIC, study)]
    errors = pd.Series(errors_of(told, _METRIC), told["estimator"].to_numpy())
    medians = errors.groupby(level=0).median().drop(FLOOR, errors="ignore")
    if len(medians) < 2:
        raise NotDrawnError("it takes two estimators")
    first, *others = (str(name) for name in medians.sort_values(kind="stable").index)
    wins = win_table(win_counts(attempts[attempts["estimator"].isin([first, *others])], study))
    wins = wins[wins["error"] == _METRIC.name]
    forth, back = wins[wins["estimator"] == first], wins[wins["other"] == first]
    shares = dict(zip(forth["other"], forth["wins"], strict=True))
    shares |= dict(zip(back["estimator"], 1 - back["wins"], strict=True))
    predicted = attempts[_drawn(attempts)].groupby("estimator").size()
    return first, max(others, key=lambda name: (shares.get(name, 0.0), predicted.get(name, 0)))


def _drawn(attempts: pd.DataFrame) -> pd.Series:
    """Which trials have a prediction by the published step."""
    return attempts["status"].eq("ok") & ~attempts["published_forward"].eq(0)


def _pairs(attempts: pd.DataFrame, first: str, second: str) -> pd.DataFrame:
    """Trials of both: whether both have a prediction, and the difference of their errors."""
    errors = attempts[_METRIC.name]
    told = attempts[_TRIAL].assign(drawn=_drawn(attempts) & errors.notna(), error=errors)
    parts = [told[attempts["estimator"] == name] for name in (first, second)]
    pairs = parts[0].merge(parts[1], on=_TRIAL)
    gap = (pairs["error_x"] - pairs["error_y"]).abs()
    return pairs[_TRIAL].assign(drawn=pairs["drawn_x"] & pairs["drawn_y"], gap=gap)


def _scenes(attempts: pd.DataFrame, choice: Choice, study: Study) -> Iterator[tuple[int, Scene]]:
    for seed in choice.seeds[:_TRIES]:
        yield seed, scene_of(attempts[attempts["seed"] == seed], study)


def _row(scene: Scene, choice: Choice, seed: int, estimator: str) -> dict[str, object]:
    rows = scene.trials
    here = (rows["estimator"] == estimator) & (rows["sensor"] == choice.sensor)
    (row,) = rows[here & (rows["sigma"] == choice.sigma) & (rows["seed"] == seed)].to_dict(
        "records"
    )
    return {str(key): value for key, value in row.items()}


def _ends() -> list[tuple[Artist, str]]:
    """Entries of a legend: where cars are at the end."""
    true, colour = Patch(facecolor=to_rgba("black", 0.15), edgecolor="black"), player_colour(0)
    predicted = Patch(facecolor=to_rgba(colour, 0.15), edgecolor=colour)
    return [(true, "true end"), (predicted, "predicted end")]


def _prediction(
    axes: Axes, scene: Scene, row: dict[str, object], states: np.ndarray | None
) -> None:
    assert states is not None
    draw_bundle(axes, scene, states, linewidth=2)
    for i, state in enumerate(states[-1]):
        scene.draw_car(axes, state, player_colour(i), filled=False)
    name = style.printable(str(row["estimator"]))
    axes.set_title(f"{name} predicts, {row[_METRIC.name]:.2g} m off")
