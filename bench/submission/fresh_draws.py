"""Confirm implausible rows: run their estimators on draws that nobody can know.

Draws and noise have a new secret salt for each estimator, scenario, sensor and noise level. Of an
estimator that is really so good, half of the fresh errors are at most the median of the implausible
ones, and fewer than a quarter of 20 are so in one of 170 cases; of others hardly any are.
"""

import secrets
from collections.abc import Generator, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import count, islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd

from olne_bench.bench.judge.metrics.cosine_error import CosineError
from olne_bench.bench.judge.metrics.declaration import MetricDeclaration, declare
from olne_bench.bench.judge.metrics.position_error import PositionError
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import Trial
from olne_bench.bench.report.confirmations import Confirmation
from olne_bench.bench.report.statistics.attempts import attempts_of, errors_of, median, places_of
from olne_bench.bench.report.statistics.plausibility import implausible
from olne_bench.bench.report.statistics.standing import KEY
from olne_bench.bench.report.study import Study
from olne_bench.bench.run.executor import run_trials

#: As the file of a run that holds what estimators print.
_LOG = "workers.log"
#: Fewest fresh attempts for each estimator, scenario and sensor.
FEWEST = 20
#: Errors that are compared.
_METRICS = (declare(PositionError), declare(CosineError))
#: Share of fresh errors that must be at most the median of the implausible ones.
_ENOUGH = 0.25
#: Draws of a family without an equilibrium are no attempts: this many rounds replace them.
_ROUNDS = 20


@dataclass(frozen=True)
class Machine:
    """How trials are run."""

    jobs: int  # trials at the same time
    memory: int  # limit of each process that runs foreign code [bytes]
    hidden: Path  # folder that foreign code cannot read


def row_of(trial: Trial, outcome: Outcome) -> dict[str, Any]:
    """The row of a trial, as tables have it."""
    return trial.labels | outcome.columns | outcome.scores


def run_all(
    trials: Iterable[Trial], machine: Machine
) -> Generator[tuple[Trial, Outcome], None, None]:
    """Run trials in places named as those of a run, so that they cannot tell a check from it."""
    with TemporaryDirectory() as place:
        yield from run_trials(trials, **vars(machine), log=Path(place) / _LOG)


@dataclass(frozen=True)
class Suspect:
    """An estimator with implausible rows in a scenario and sensor."""

    trials: tuple[Trial, ...]  # one of each noise level that has such rows
    rows: pd.DataFrame


def suspects(
    table: pd.DataFrame, study: Study, planned: Mapping[tuple[str, ...], Trial]
) -> list[Suspect]:
    """Who has implausible rows in a run, and where.

    ``planned``: trials with the present code, one of each ``trial_place``.
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
    """The key of ``suspects``' planned trials: scenario, sensor, estimator, noise level as text."""
    return *place, str(float(sigma))


def confirm(suspect: Suspect, number: int, machine: Machine) -> Confirmation:
    """What at least ``number`` fresh attempts say of an estimator's implausible rows."""
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
    again = median(errors_of(fresh, metric)) if len(fresh) else np.inf
    labels = suspect.trials[0].labels
    return Confirmation(
        **{name: labels[name] for name in (*KEY, "parameters")},
        versions=suspect.trials[0].versions,
        sigmas=tuple(sorted(float(trial.sigma) for trial in suspect.trials)),
        rows=len(suspect.rows),
        trials=len(fresh),
        metric=metric.name,
        error=median(errors_of(suspect.rows, metric)),
        fresh_error=float(again) if np.isfinite(again) else None,
        as_small=small,
        confirmed=len(fresh) >= FEWEST and small >= _ENOUGH * len(fresh),
    )


def _as_small(rows: pd.DataFrame, fresh: pd.DataFrame, metric: MetricDeclaration) -> int:
    """How many fresh errors are at most the median of the rows with their noise level."""
    if fresh.empty:
        return 0
    medians = {sigma: median(errors_of(own, metric)) for sigma, own in rows.groupby("sigma")}
    return int((errors_of(fresh, metric) <= fresh["sigma"].map(medians)).sum())


def _fresh(trials: Iterable[Trial]) -> Iterator[Trial]:
    """Trials like these in turn, without end: each like one of them, with its own salt."""
    salted = [replace(t, salt=secrets.token_hex(16), count=1, draws=None) for t in trials]
    for seed in count():
        yield from (replace(trial, seed=seed) for trial in salted)
