"""What the page's charts show, as plain lists and numbers."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.figures import style
from olne_bench.bench.report.figures.curves import rolling_errors
from olne_bench.bench.report.figures.error_panels import failed_rows, floor_error
from olne_bench.bench.report.figures.levels import LevelStatistics, has_curve, level_statistics
from olne_bench.bench.report.figures.rolling import RollingStatistics
from olne_bench.bench.report.figures.series import Series, split
from olne_bench.bench.report.measures import primary
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.page.numbers import rounded
from olne_bench.bench.report.page.scenes import Place, scene_data
from olne_bench.bench.report.parts import Outline, Parts, of_each, parts_of
from olne_bench.bench.report.study import USUAL, Study
from olne_bench.envs.worlds.scene import PLAYER_COLOURS

#: Largest number of points on the whole page; of more trials, an even selection is drawn.
_MOST_POINTS = 14_000
_FEWEST_POINTS = 60  # of a series
_MOST_NODES = 120  # of a rolling line


@dataclass(frozen=True)
class ChartData:
    """What the page's script draws.

    Attributes:
        content: plain data.
        notes: what cannot be drawn, and why.
    """

    content: dict[str, Any]
    notes: list[str]


def chart_data(
    trials: pd.DataFrame | Parts, study: Study = USUAL, wanted: Sequence[Place] = ()
) -> ChartData:
    """Collect what the page's script draws.

    Args:
        trials: trials of a run.
        study: study of the run.
        wanted: noise levels and seeds of sequences that must be playable.
    """
    parts = parts_of(trials)
    outline = parts.outline
    metrics = errors_shown(outline, study)
    names = style.estimator_order(outline.cells["estimator"].tolist())
    drawn = int((outline.cells["estimator"] != style.FLOOR).sum())
    most = max(_FEWEST_POINTS, _MOST_POINTS // max(1, drawn))
    number = len(outline.scenarios)

    def scenario(name: str, own: pd.DataFrame) -> tuple[dict[str, Any], list[str]]:
        series, scene, lost = _scenario(name, own, number, study, wanted)
        curves = has_curve(series)
        shown = [_series(s, most, metrics, curves) for s in series]
        return {"name": name, "curves": curves, "series": shown, "scene": scene}, lost

    found = of_each(parts, scenario)
    content = {
        "metrics": [_metric(metric) for metric in metrics],
        "primary": getattr(primary(metrics), "name", None),
        "sensors": list(
            style.sensor_slots(outline.cells["sensor"].unique().tolist(), known_only=True)
        ),
        "estimators": [
            {"name": name, "colours": style.estimator_colours(name), "floor": name == style.FLOOR}
            for name in names
        ],
        "players": PLAYER_COLOURS,
        "scenarios": [content for content, _ in found],
    }
    return ChartData(content, [note for _, lost in found for note in lost])


def _scenario(
    name: str, trials: pd.DataFrame, number: int, study: Study, wanted: Sequence[Place]
) -> tuple[list[Series], dict[str, Any] | None, list[str]]:
    """Series and scene of one scenario, as far as they can be drawn, and why not."""
    series: list[Series] = []
    plain = trials.drop(columns=["weights", "weight_levels"], errors="ignore")
    try:
        series = split(plain, study)
        return series, scene_data(trials, number=number, study=study, wanted=wanted), []
    except NotDrawnError as error:
        return series, None, [f"trajectories of {name} on the page: {error}"]


def errors_shown(outline: Outline, study: Study) -> list[MetricDeclaration]:
    """The errors that have charts, and columns among the values of a trial."""
    return [metric for metric in outline.metrics(study.metrics) if not metric.is_share]


def _metric(metric: MetricDeclaration) -> dict[str, Any]:
    return {
        "name": metric.name,
        "label": metric.label,
        "title": metric.title,
        "unit": metric.unit,
        "negligible": metric.negligible,
        "prediction": metric.needs_prediction,
    }


def _series(
    series: Series, most: int, metrics: Sequence[MetricDeclaration], curves: bool
) -> dict[str, Any]:
    order = np.argsort(series.observation_error, kind="stable")
    every = -(-len(order) // most)
    shown = order[::every]
    rows = series.trials.iloc[shown]
    return {
        "estimator": series.estimator,
        "sensor": series.sensor,
        "colour": series.colour,
        "dash": style.LINE_STYLES.index(series.line_style),
        "light": style.is_light(str(series.colour)),
        "every": every,
        "points": None
        if series.is_floor
        else {
            "x": rounded(series.observation_error[shown]),
            "sigma": rows["sigma"].tolist(),
            "seed": rows["seed"].tolist(),
            "status": rows["status"].tolist(),
            "published": series.published_failed[shown].astype(int).tolist(),
            **{metric.name: _points(series, metric, shown) for metric in metrics},
        },
        "rolling": {metric.name: _middle(series, metric, curves) for metric in metrics},
    }


def _points(
    series: Series, metric: MetricDeclaration, shown: np.ndarray
) -> list[float | str | None]:
    """Errors; None for a failure, and a dash where the metric does not apply."""
    values: list[float | None] = rounded(series.error(metric)[shown])
    about = series.measured(metric)[shown]
    return [value if told else "–" for value, told in zip(values, about, strict=True)]


def _middle(
    series: Series, metric: MetricDeclaration, curves: bool
) -> dict[str, list[float | None]]:
    """Median and quartiles: rolling ones, those of each noise level, or the floor's one line."""
    told: RollingStatistics | LevelStatistics
    if series.is_floor:
        ends = np.array([0.0, series.observation_error.max()])
        level = np.full(2, floor_error(series, metric))
        told = RollingStatistics(ends, level, level, level)
    elif curves:
        told = rolling_errors(series, metric, _MOST_NODES)
    else:
        told = level_statistics(series, metric, failed_rows(series, metric))
    sigma = {"sigma": told.sigma.tolist()} if isinstance(told, LevelStatistics) else {}
    return {
        **sigma,
        "x": rounded(told.x),
        "low": rounded(told.lower),
        "mid": rounded(told.median),
        "high": rounded(told.upper),
    }
