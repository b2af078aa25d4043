"""Confirm implausible rows: run their estimators on draws that nobody can know.

Draws and noise have a new secret salt for each estimator, scenario, sensor and noise level, so that
what is remembered of one place helps in no other. An estimator that is really so good has the same
errors there: of its fresh errors half are at most the median of the implausible ones, and fewer
than a quarter of 20 are so in one of 170 cases. Of an honest estimator whose rows knew the truth
hardly any are.
"""

import secrets
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import count, islice

import numpy as np
import pandas as pd

from olne_bench.bench.judge.metrics.cosine_error import CosineError
from olne_bench.bench.judge.metrics.declaration import MetricDeclaration, declare
from olne_bench.bench.judge.metrics.position_error import PositionError
from olne_bench.bench.plan.trial import Trial
from olne_bench.bench.report.confirmations import Confirmation
from olne_bench.bench.report.machine import Machine, row_of, run_all
from olne_bench.bench.report.statistics.attempts import attempts_of, errors_of, quantile
from olne_bench.bench.report.statistics.plausibility import implausible, places_of
from olne_bench.bench.report.statistics.standing import KEY
from olne_bench.bench.report.study import Study

#: Fewest fresh attempts for each estimator, scenario and sensor.
FEWEST = 20
#: Errors that are compared.
_METRICS = (declare(PositionError), declare(CosineError))
#: Share of fresh errors that must be at most the median of the implausible ones.
_ENOUGH = 0.25
#: Draws of a family without an equilibrium are no attempts: this many rounds replace them.
_ROUNDS = 20


@dataclass(frozen=True)
class Suspect:
    """An estimator with implausible rows in a scenario and sensor.

    Attributes:
        trials: a trial of each noise level that has such rows.
        rows: these rows.
    """

    trials: tuple[Trial, ...]
    rows: pd.DataFrame


def suspects(
    table: pd.DataFrame, study: Study, planned: Mapping[tuple[str, ...], Trial]
) -> list[Suspect]:
    """Who has implausible rows, and where.

    Args:
        table: rows of a run.
        study: study of the run.
        planned: trials of the run with the present code, one of each scenario, sensor, noise level
            and estimator, by these as text.
    """
    marked = table[implausible(table, study)].reset_index(drop=True)
    found = []
    for place, numbers in places_of(marked, KEY).items():
        rows = marked.iloc[numbers]
        levels = sorted(rows["sigma"].unique())
        trials = tuple(planned[trial_place(place, level)] for level in levels)
        found.append(Suspect(trials, rows))
    return found


def trial_place(place: Iterable[str], sigma: float) -> tuple[str, ...]:
    """The key of ``suspects``' planned trials."""
    return *place, str(float(sigma))


def confirm(suspect: Suspect, number: int, machine: Machine) -> Confirmation:
    """What fresh draws say of an estimator's implausible rows in a scenario and sensor.

    Args:
        suspect: the estimator and its rows.
        number: least number of fresh attempts.
        machine: where they run.
    """
    numbered = _fresh(suspect.trials)
    attempts = pd.DataFrame()
    for _ in range(_ROUNDS):
        chosen = list(islice(numbered, number - len(attempts)))
        rows = pd.DataFrame(row_of(*ended) for ended in run_all(chosen, machine))
        attempts = pd.concat([attempts, attempts_of(rows)], ignore_index=True)
        if len(attempts) >= number:
            break
    return compared(suspect, attempts)


def compared(suspect: Suspect, fresh: pd.DataFrame) -> Confirmation:
    """The outcome of fresh attempts, which may be too few."""
    outcomes = [(_as_small(suspect.rows, fresh, metric), metric) for metric in _METRICS]
    small, metric = min(outcomes, key=lambda outcome: outcome[0])
    again = _median(errors_of(fresh, metric)) if len(fresh) else np.inf
    labels = suspect.trials[0].labels
    return Confirmation(
        scenario=labels["scenario"],
        sensor=labels["sensor"],
        estimator=labels["estimator"],
        parameters=labels["parameters"],
        versions=suspect.trials[0].versions,
        sigmas=tuple(sorted(float(trial.sigma) for trial in suspect.trials)),
        rows=len(suspect.rows),
        trials=len(fresh),
        metric=metric.name,
        error=_median(errors_of(suspect.rows, metric)),
        fresh_error=float(again) if np.isfinite(again) else None,
        as_small=small,
        confirmed=len(fresh) >= FEWEST and small >= _ENOUGH * len(fresh),
    )


def _as_small(rows: pd.DataFrame, fresh: pd.DataFrame, metric: MetricDeclaration) -> int:
    """How many fresh errors are at most the median of the rows with their noise level."""
    if fresh.empty:
        return 0
    medians = {sigma: _median(errors_of(own, metric)) for sigma, own in rows.groupby("sigma")}
    return int((errors_of(fresh, metric) <= fresh["sigma"].map(medians)).sum())


def _fresh(trials: Iterable[Trial]) -> Iterator[Trial]:
    """Trials like these in turn, without end: each like one of them, with its own salt."""
    salted = [replace(t, salt=secrets.token_hex(16), count=1, draws=None) for t in trials]
    for seed in count():
        yield from (replace(trial, seed=seed) for trial in salted)


def _median(values: np.ndarray) -> float:
    return quantile(values, np.ones(len(values), int), 0.5)
