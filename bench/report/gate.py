"""Check a run against the limits of its suite."""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from olne_bench.bench.plan.entries import GateLimits
from olne_bench.bench.plan.select import select
from olne_bench.bench.plan.suite import Suite, read_suite_json
from olne_bench.bench.report.statistics.standing import ranks_at
from olne_bench.bench.report.study import IDENTIFIABLE, USUAL, Study, primary, scored
from olne_bench.bench.run.provenance import Provenance
from olne_bench.errors import UserError

_KEY = ["estimator", "scenario", "sensor", "sigma", "seed"]

#: Columns of the leaderboard that can be limited in every run, whatever its metrics.
_COUNTS = ("limit_ratio", "failures", "published_failures")
#: Limits the score by the primary metric; after a metric's name, that by the metric.
_SCORE = "score"
_TIME = "time_ratio"  # of medians, to another estimator's


@dataclass(frozen=True)
class Task:
    """What a run was asked to do: the selected part of its suite, and a number of noise draws."""

    suite: Suite
    seeds: int


def task_of(run: Provenance) -> Task:
    """What a stored run was asked to do."""
    return Task(select(read_suite_json(run.suite), run.selection), run.seeds)


@dataclass(frozen=True)
class LimitOutcome:
    """The outcome of one limit in one scenario and sensor."""

    estimator: str
    scenario: str
    sensor: str
    limit: str  # of ``GateLimits``, or ``implausible``: no gate allows such rows unconfirmed
    value: float  # NaN if it is unknown
    bound: float  # largest value allowed

    @property
    def passed(self) -> bool:
        """Whether the limit is kept; an unknown value does not keep it."""
        return self.value <= self.bound


def check_limits(
    table: pd.DataFrame, gate: Mapping[str, GateLimits], study: Study = USUAL
) -> list[LimitOutcome]:
    """The outcome of every limit, by estimator, in a leaderboard.

    UserError on a limit that is not allowed, or that no trial is about: none passes unchecked.
    """
    columns = _columns(study)
    for estimator, limits in gate.items():
        for name in limits.bounds:
            if name not in columns:
                raise UserError(
                    f"[gate.{estimator}] limits {name!r}, which is not a metric of the run that a "
                    f"gate may limit; there are: {', '.join(columns)}"
                )
    return [one for name, limits in gate.items() for one in _outcomes(table, name, limits, columns)]


def _columns(study: Study) -> dict[str, str]:
    """The limits that a gate may set, and the columns of a leaderboard that they are about."""
    gated = [metric.name for metric in (*study.metrics, IDENTIFIABLE) if metric.gated]
    scores = [f"{metric.name}_{_SCORE}" for metric in scored(study.metrics)]
    columns = {name: f"{name}_median" for name in gated}
    columns[_SCORE] = f"{getattr(primary(study.metrics), 'name', '')}_{_SCORE}"
    return columns | {name: name for name in (*scores, *_COUNTS, _TIME)}


def missing_trials(trials: pd.DataFrame, tasks: Iterable[Task]) -> list[str]:
    """Which trials of the tasks of a run are missing, a line per estimator, scenario and sensor."""
    planned = {key for task in tasks for key in _keys(task)}
    done = set(trials[_KEY].itertuples(index=False, name=None))
    whole = Counter(key[:3] for key in planned)
    missing = Counter(key[:3] for key in planned - done)
    return [
        f"{', '.join(place)}: {whole[place] - number} of {whole[place]} trials are done"
        for place, number in sorted(missing.items())
    ]


def _keys(task: Task) -> Iterator[tuple[str, str, str, float, int]]:
    """The trials of a task, as ``plan.trial.expand`` has them; unknown plugins are allowed."""
    suite = task.suite
    for scenario, estimator in suite.pairs():
        seeds = range(min(task.seeds, suite.seeds_of(scenario, estimator)))
        fixed = not scenario.family
        for sensor, sigma in product(suite.sensors, suite.sigmas_of(scenario)):
            for seed in seeds[:1] if fixed and sigma == 0 else seeds:
                yield estimator.label, scenario.label, sensor.label, sigma, seed


def _outcomes(
    table: pd.DataFrame, estimator: str, limits: GateLimits, columns: Mapping[str, str]
) -> Iterator[LimitOutcome]:
    _require("estimator", [estimator], table["estimator"])
    rows = table[table["estimator"] == estimator]
    for what, names in (("scenario", limits.scenarios), ("sensor", limits.sensors)):
        _require(what, names, table[what])
        rows = rows[rows[what].isin(names)] if names else rows
    tried = rows[rows["trials"] > 0]
    if tried.empty:
        raise UserError(f"[gate.{estimator}]: the run has no trial that its limits are about")
    for row in tried.assign(ranks=ranks_at(tried)).to_dict("records"):
        place = estimator, row["scenario"], row["sensor"]
        if not row["ranks"] and row.get("implausible", 0) > 0:
            yield LimitOutcome(*place, "implausible", float(row["implausible"]), 0.0)
        for limit, bound in limits.bounds.items():
            value = row.get(columns[limit], math.nan)
            if limit == _TIME:
                value = row["solve_seconds_median"] / _time(table, row, limits.time_reference)
            yield LimitOutcome(*place, limit, float(value), bound)


def _time(table: pd.DataFrame, row: Mapping[Any, Any], reference: str) -> float:
    _require("time_reference", [reference], table["estimator"])
    same = (table["scenario"] == row["scenario"]) & (table["sensor"] == row["sensor"])
    found = table.loc[same & (table["estimator"] == reference), "solve_seconds_median"]
    # The median is infinite if more than half of the reference's attempts did not end.
    return float(found.iloc[0]) if len(found) and np.isfinite(found.iloc[0]) else math.nan


def _require(what: str, names: list[str] | tuple[str, ...], known: pd.Series) -> None:
    for name in names:
        if name not in set(known):
            choice = ", ".join(sorted(set(known)))
            raise UserError(
                f"the gate names {what} {name!r}, of which the run has none; it has: {choice}"
            )
