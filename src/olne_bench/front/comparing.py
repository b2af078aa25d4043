"""Compare estimators in this process, judged as a study judges them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any

import pandas as pd

from olne_bench import plugins
from olne_bench.bench.judge.metrics import BUILT_IN
from olne_bench.bench.judge.players import Staff
from olne_bench.bench.judge.trials import Case, case_at, judge_case
from olne_bench.bench.judge.truth import Draw
from olne_bench.bench.plan.entries import MetricEntry
from olne_bench.bench.plan.outcome import FAILURES, Outcome
from olne_bench.bench.plan.trial import LABEL_COLUMNS, Trial
from olne_bench.bench.report.leaderboard import leaderboard
from olne_bench.bench.report.study import Study
from olne_bench.bench.text import clip
from olne_bench.checks import check_count
from olne_bench.envs.scenarios.scenario import NoEquilibriumError, Scenario
from olne_bench.front.drawing import ChosenSensor, Place, chosen_sensor, place_of
from olne_bench.front.in_process import (
    ChosenEstimator,
    NoForeignMetrics,
    PlayerHere,
    chosen_estimator,
)
from olne_bench.games.solve.ipopt import PUBLISHED_ITERATIONS
from olne_bench.plugins import METRIC

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Trials that are run without being asked for: with seconds each, more take hours.
MOST_TRIALS = 10_000
#: Columns that hold no single number or text.
_NOT_TIDY = ["weights", "unknowns", "weight_levels", "extras", "count", "salt_id", "suite"]
_WARNING = "nothing isolates these estimators: they ran in the process that knows the truth"
_IN_SHORT = "nothing isolates the estimators from the truth"


@dataclass(frozen=True, repr=False)
class Comparison:
    """Trials of several estimators on the same observations.

    Nothing isolates the estimators: they ran in the process that knows the truth. Numbers to be
    published come from a study, ``olne_bench.run``.

    Attributes:
        trials: one row per trial, with all columns of a study's ``trials.parquet``.
    """

    trials: pd.DataFrame

    @property
    def frame(self) -> pd.DataFrame:
        """One row per trial: what was run, its status, and its scores.

        Scores are NaN where a trial failed or a metric does not apply. Errors of positions are in
        metres, times in seconds.
        """
        return self.trials.drop(columns=_NOT_TIDY).dropna(axis="columns", how="all")

    @property
    def leaderboard(self) -> pd.DataFrame:
        """One row per scenario, sensor and estimator; a failure counts as infinitely wrong."""
        return leaderboard(self.trials)

    def plot(
        self,
        scenario: str | None = None,
        metrics: Sequence[str] = ("position_error", "cosine_error"),
    ) -> "Figure":
        """Errors over the noise, one row of panels per metric.

        Args:
            scenario: label of the scenario. Default: the only one.
            metrics: names of metrics; a ``NotDrawnError`` if none has a value.

        Raises:
            ValueError: if there are several and none is named, or this one is not there.
            NotDrawnError: if no trial was attempted.
        """
        import matplotlib.pyplot  # noqa: F401 (notebooks show figures once it is there)

        from olne_bench.bench.report.figures import over_noise, style

        known = list(dict.fromkeys(self.trials["scenario"]))
        chosen = known[0] if scenario is None and len(known) == 1 else scenario
        if chosen not in known:
            raise ValueError(f"plot needs one scenario of {', '.join(known)}, got {scenario!r}")
        drawn = Study(metrics=tuple(one for one in BUILT_IN if one.name in metrics))
        with style.applied():
            figure = over_noise.draw_errors(self.trials[self.trials["scenario"] == chosen], drawn)
            figure.suptitle(f"{chosen}: error of the estimates\n({_IN_SHORT})", fontsize=8.5)
            figure.draw_without_rendering()
            figure.set_layout_engine("none")  # computed with these settings, not the user's
        return figure

    def __repr__(self) -> str:
        """How much was run, how much failed, the medians, and a warning."""
        failed = int(self.trials["status"].isin(FAILURES).sum())
        columns = ["scenario", "sensor", "estimator", "position_error_median"]
        table = self.leaderboard
        shown = table[[name for name in columns if name in table]]
        return (
            f"Comparison({len(self.trials)} trials, {failed} failed; {_WARNING})\n"
            f"{shown.to_string(index=False)}"
        )


def compare(
    scenario: str | Scenario | Sequence[str | Scenario],
    estimators: Sequence[Any] | Mapping[str, Any],
    *,
    sensor: Any = "full",
    sigma: float | Sequence[float] = 0.05,
    seeds: int = 1,
    time_limit: float = 60.0,
    most_trials: int = MOST_TRIALS,
) -> Comparison:
    """Run estimators on the same observations, and judge them by the truth.

    Metrics, statuses, noise and random numbers are those of a study. Failures are rows. But
    nothing isolates an estimator here: it runs in the process that knows the truth, may hang it,
    and is never stopped. Each trial has a copy of the estimator, of the problem, and of what was
    seen. ``olne_bench.run`` runs a study in processes of its own.

    Args:
        scenario: a name, whose seeds are different draws as in a study, a scenario from
            ``olne_bench.scenario``, whose seeds are different noise, one of your own, or a list.
        estimators: names, classes or objects; a mapping gives them labels.
        sensor: a sensor as of ``observe``, or a list of several. A tuple is a stack.
        sigma: noise levels, on roads standard deviations of positions [m].
        seeds: number of draws or of noises, from 0 on; without noise, one counts as all.
        time_limit: an estimate is told to end after four fifths of this [s].
        most_trials: more trials are refused.

    Raises:
        TypeError: on a scenario, estimator or sensor that is something else.
        ValueError: on unknown names, with the alternatives, two estimators of one label, numbers
            out of range, or too many trials.
    """
    places = [place_of(one) for one in _listed(scenario, str | Scenario)]
    sensors = [chosen_sensor(one) for one in (sensor if isinstance(sensor, list) else [sensor])]
    chosen, levels = _chosen(estimators), _levels(sigma)
    check_count("seeds", seeds)
    number = len(places) * len(sensors) * len(chosen) * len(levels) * seeds
    if number > most_trials:
        raise ValueError(
            f"this is {number} trials one after the other, more than most_trials = {most_trials}; "
            f"use fewer seeds, olne_bench.run for a study in processes, or most_trials={number}"
        )
    rows: list[dict[str, Any]] = []
    for place, one, level, seed in _cells(places, sensors, levels, seeds):
        count = 1 if level > 0 or place.entry.family else seeds
        first = _trial(place, one, level, seed, chosen[0])
        first = replace(first, count=count, time_limit=time_limit)
        rows += _judged(first, place.at(seed), one, chosen)
    return Comparison(pd.DataFrame(rows))


def _trial(
    place: Place, sensor: ChosenSensor, sigma: float, seed: int, who: ChosenEstimator
) -> Trial:
    metrics = [one for one in plugins.names(METRIC) if plugins.is_built_in(METRIC, one)]
    return Trial(
        suite="compare",
        scenario=place.entry,
        sensor=sensor.entry,
        sigma=sigma,
        seed=seed,
        estimator=who.entry,
        metrics=tuple(MetricEntry(name=one, column=one) for one in metrics),
        count=1,
        time_limit=60.0,
        root_iterations=PUBLISHED_ITERATIONS,
        salt=place.salt,
    )


def _cells(
    places: Sequence[Place], sensors: Sequence[ChosenSensor], levels: Sequence[float], seeds: int
) -> Iterator[tuple[Place, ChosenSensor, float, int]]:
    """What estimators are compared on, one draw after the other, as its truth is kept."""
    for place in places:
        for seed, one, level in product(range(seeds), sensors, levels):
            if seed == 0 or level > 0 or place.entry.family:
                yield place, one, level, seed


def _judged(
    first: Trial, draw: Draw, sensor: ChosenSensor, chosen: Sequence[ChosenEstimator]
) -> Iterator[dict[str, Any]]:
    """Rows of estimators on the same observation, that of the first one's trial."""
    case: Case | Outcome
    try:
        case = case_at(draw, sensor.layers, first)
    except NoEquilibriumError as error:
        case = Outcome("skipped", clip(str(error)))
    for who in chosen:
        trial = replace(first, estimator=who.entry)
        if isinstance(case, Outcome):
            outcome = case
        else:
            outcome = judge_case(trial, case, Staff(PlayerHere(who.made), NoForeignMetrics()))
        labels = {name: trial.labels[name] for name in LABEL_COLUMNS}
        scores = {entry.name: outcome.scores.get(entry.name) for entry in trial.metrics}
        yield labels | outcome.columns | scores


def _chosen(given: Sequence[Any] | Mapping[str, Any]) -> list[ChosenEstimator]:
    if isinstance(given, Mapping):
        chosen = [chosen_estimator(one, str(label)) for label, one in given.items()]
    else:
        chosen = [chosen_estimator(one) for one in _listed(given, str)]
    labels = [one.entry.label for one in chosen]
    for label in labels:
        if labels.count(label) > 1:
            raise ValueError(
                f"two estimators are called {label!r}; give a mapping of labels to estimators"
            )
    if not chosen:
        raise ValueError("estimators must name at least one, got none")
    return chosen


def _listed(given: Any, single: Any) -> list[Any]:
    """A list of what may be given alone."""
    if isinstance(given, single) or not isinstance(given, list | tuple):
        return [given]
    return list(given)


def _levels(sigma: Any) -> list[float]:
    levels = list(sigma) if hasattr(sigma, "__iter__") and not isinstance(sigma, str) else [sigma]
    for level in levels:
        if isinstance(level, bool | str) or not (float(level) >= 0 and float(level) < float("inf")):
            raise ValueError(f"sigma must hold finite numbers of at least 0, got {level!r}")
    if not levels:
        raise ValueError("sigma must hold at least one noise level, got none")
    return [float(level) for level in levels]
