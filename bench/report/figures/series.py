"""The trials of one scenario, taken apart into what a figure draws as one thing."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.typing import ColorType, LineStyleType

from olne_bench.bench.report.figures import style
from olne_bench.bench.report.leaderboard import published_failures
from olne_bench.bench.report.statistics.attempts import errors_of

#: Views in the order in which they are drawn; others follow.
_VIEW_ORDER = ("full", "partial")


@dataclass(frozen=True)
class Series:
    """All attempts of one estimator in one view.

    Attributes:
        estimator: its label, arbitrary text.
        view: name of the view.
        trials: its rows; trials that the estimator declined (``skipped``) are not among them.
        colour: of lines and points.
        line_style: tells views apart without colour.
        marker: tells estimators apart where colours repeat.
    """

    estimator: str
    view: str
    trials: pd.DataFrame
    colour: ColorType
    line_style: LineStyleType
    marker: str

    @property
    def name(self) -> str:
        """What the legend says."""
        if self.is_floor:
            return f"{self.estimator} (floor)"
        return f"{style.printable(self.estimator)}, {style.printable(self.view)} view"

    @property
    def is_floor(self) -> bool:
        """Whether this is the reference that others must beat."""
        return self.estimator == style.FLOOR

    @property
    def observation_error(self) -> np.ndarray:
        """Mean absolute position noise [m] of each row.

        Where an attempt left no such number, its expectation sigma * sqrt(2 / pi).
        """
        expected = self.trials["sigma"].to_numpy(float) * np.sqrt(2 / np.pi)
        measured = self.trials["observation_error"].to_numpy(float)
        return np.where(np.isfinite(measured), measured, expected)

    def error(self, column: str) -> np.ndarray:
        """An error of each row, infinite for failures."""
        return errors_of(self.trials, column)

    @property
    def count(self) -> np.ndarray:
        """How many trials each row stands for."""
        return self.trials["count"].to_numpy(int)

    @property
    def failed(self) -> np.ndarray:
        """Whether each row is a failure, of whatever kind."""
        return (self.trials["status"] != "ok").to_numpy(bool)

    @property
    def published_failed(self) -> np.ndarray:
        """Whether each row is a failure by the published definition."""
        return published_failures(self.trials)


def split(trials: pd.DataFrame) -> list[Series]:
    """Series of one scenario, contenders first, the floor last."""
    attempts = trials[trials["status"] != "skipped"]
    estimators = style.estimator_order(attempts["estimator"].tolist())
    views = views_in(attempts)
    colours = style.estimator_colours(estimators)
    series: list[Series] = []
    for place, estimator in enumerate(estimators):
        for column, view in enumerate(views):
            rows = attempts[(attempts["estimator"] == estimator) & (attempts["view"] == view)]
            if rows.empty:
                continue
            if estimator == style.FLOOR and any(s.is_floor for s in series):
                continue  # it looks at no observation, so one view tells all
            series.append(
                Series(
                    estimator,
                    view,
                    rows,
                    colour=colours[estimator][min(column, 1)],
                    line_style=style.LINE_STYLES[column % len(style.LINE_STYLES)],
                    marker=style.MARKERS[place % len(style.MARKERS)],
                )
            )
    return series


def contenders(series: list[Series]) -> list[Series]:
    """The series without the floor, unless it is all there is."""
    return [s for s in series if not s.is_floor] or series


def views_in(trials: pd.DataFrame) -> list[str]:
    """Names of the views that occur, the paper's first."""
    names = trials["view"].unique().tolist()
    return [v for v in _VIEW_ORDER if v in names] + sorted(set(names) - set(_VIEW_ORDER))
