"""What the page's charts show, as plain lists and numbers."""

from typing import Any

import numpy as np
import pandas as pd

from olne_bench.bench.report.figures import style
from olne_bench.bench.report.figures.errors import rolling_errors
from olne_bench.bench.report.figures.series import Series, split
from olne_bench.bench.report.page.numbers import significant
from olne_bench.bench.report.page.scenes import scene_data
from olne_bench.bench.report.statistics.attempts import ERRORS

#: Trials drawn as points, on the whole page; beyond, some are left out, evenly.
_MOST_POINTS = 14_000
_FEWEST_POINTS = 60  # of a series
_MOST_NODES = 120  # of a rolling line


def chart_data(trials: pd.DataFrame) -> dict[str, Any]:
    """Everything that the page's script draws.

    Args:
        trials: of a run.
    """
    names = sorted(trials["scenario"].unique())
    plain = trials.drop(columns="weights")
    parts = {name: split(plain[plain["scenario"] == name]) for name in names}
    drawn = sum(not s.is_floor for series in parts.values() for s in series)
    most = max(_FEWEST_POINTS, _MOST_POINTS // max(1, drawn))
    estimators = style.estimator_order(trials["estimator"].tolist())
    colours = style.estimator_colours(estimators)
    return {
        "estimators": [
            {"name": name, "colours": colours[name], "floor": name == style.FLOOR}
            for name in estimators
        ],
        "players": style.PLAYER_COLOURS,
        "scenarios": [
            {
                "name": name,
                "series": [_series(s, most) for s in series],
                "scene": scene_data(trials[trials["scenario"] == name], number=len(names)),
            }
            for name, series in parts.items()
        ],
    }


def _series(series: Series, most: int) -> dict[str, Any]:
    order = np.argsort(series.observation_error, kind="stable")
    every = -(-len(order) // most)
    shown = order[::every]
    rows = series.trials.iloc[shown]
    return {
        "estimator": series.estimator,
        "view": series.view,
        "dashed": series.line_style != style.LINE_STYLES[0],
        "light": series.colour == style.estimator_colours([series.estimator])[series.estimator][1],
        "every": every,
        "points": None
        if series.is_floor
        else {
            "x": significant(series.observation_error[shown]),
            "sigma": rows["sigma"].tolist(),
            "seed": rows["seed"].tolist(),
            "status": rows["status"].tolist(),
            "published": series.published_failed[shown].astype(int).tolist(),
            **{error: significant(series.error(error)[shown]) for error in ERRORS},
        },
        "rolling": {error: _rolling(series, error) for error in ERRORS},
    }


def _rolling(series: Series, error: str) -> dict[str, list[float | None]]:
    rolling = rolling_errors(series, error, _MOST_NODES)
    return {
        "x": significant(rolling.x),
        "low": significant(rolling.lower),
        "mid": significant(rolling.median),
        "high": significant(rolling.upper),
    }
