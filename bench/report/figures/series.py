"""The trials of one scenario, split into the series of a figure."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.typing import ColorType, LineStyleType

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.figures import style
from olne_bench.bench.report.leaderboard import published_failures
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.statistics.attempts import attempts_of, errors_of, measured
from olne_bench.bench.report.study import USUAL, Study


@dataclass(frozen=True)
class Series:
    """All attempts of one estimator with one sensor.

    Attributes:
        estimator: label of the estimator, arbitrary text.
        sensor: name of the sensor.
        trials: rows of the attempts, without trials that the estimator declined (``skipped``).
        colour: colour of lines and points.
        line_style: distinguishes sensors without colour.
        marker: distinguishes estimators if colours repeat.
        study: study of the run.
    """

    estimator: str
    sensor: str
    trials: pd.DataFrame
    colour: ColorType
    line_style: LineStyleType
    marker: str
    study: Study = USUAL

    @property
    def name(self) -> str:
        """Name of the series in the legend."""
        if self.is_floor:
            return f"{self.estimator} (floor)"
        return f"{style.printable(self.estimator)}, {style.printable(self.sensor)}"

    @property
    def is_floor(self) -> bool:
        """Whether this is the reference that others must beat."""
        return self.estimator == style.FLOOR

    @property
    def observation_error(self) -> np.ndarray:
        """Mean absolute position noise [m] of each row.

        If a row has no such number, it is the expectation sigma * sqrt(2 / pi).
        """
        expected = self.trials["sigma"].to_numpy(float) * np.sqrt(2 / np.pi)
        measured = self.trials["observation_error"].to_numpy(float)
        return np.where(np.isfinite(measured), measured, expected)

    def error(self, metric: MetricDeclaration) -> np.ndarray:
        """An error of each row, infinite for failures."""
        return errors_of(self.trials, metric)

    def measured(self, metric: MetricDeclaration) -> np.ndarray:
        """Which rows a metric applies to."""
        return measured(self.trials, metric, self.study).to_numpy(bool)

    @property
    def count(self) -> np.ndarray:
        """Number of trials that each row stands for."""
        return self.trials["count"].to_numpy(int)

    @property
    def failed(self) -> np.ndarray:
        """Whether each row is a failure, of whatever kind."""
        return (self.trials["status"] != "ok").to_numpy(bool)

    @property
    def published_failed(self) -> np.ndarray:
        """Whether each row is a failure by the published definition."""
        return published_failures(self.trials)


def split(trials: pd.DataFrame, study: Study = USUAL) -> list[Series]:
    """The series of one scenario, the floor last.

    Raises:
        NotDrawnError: if there are no attempts.
    """
    attempts = attempts_of(trials)
    if attempts.empty:
        raise NotDrawnError("nothing was attempted")
    estimators = style.estimator_order(attempts["estimator"].tolist())
    slots = style.sensor_slots([*study.sensors, *sensors_in(attempts)])
    series: list[Series] = []
    for estimator in estimators:
        for sensor in sensors_in(attempts):
            rows = attempts[(attempts["estimator"] == estimator) & (attempts["sensor"] == sensor)]
            if rows.empty:
                continue
            if estimator == style.FLOOR and any(s.is_floor for s in series):
                continue  # it uses no observation, so one sensor is enough
            series.append(
                Series(
                    estimator,
                    sensor,
                    rows,
                    colour=style.shade(style.estimator_colours(estimator), slots[sensor]),
                    line_style=style.LINE_STYLES[slots[sensor] % len(style.LINE_STYLES)],
                    marker=style.estimator_marker(estimator),
                    study=study,
                )
            )
    return series


def contenders(series: list[Series]) -> list[Series]:
    """The series without the floor, unless it is all there is."""
    return [s for s in series if not s.is_floor] or series


def sensors_in(trials: pd.DataFrame) -> list[str]:
    """Labels of the sensors that occur, the paper's first."""
    return list(style.sensor_slots(trials["sensor"].unique().tolist(), known_only=True))
