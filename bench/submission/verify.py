"""Check a submission as if a liar had made it: nothing in it is believed that can be computed."""

import os
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import Trial
from olne_bench.bench.report.confirmations import Confirmation
from olne_bench.bench.report.statistics.attempts import errors_of
from olne_bench.bench.report.study import Study, primary
from olne_bench.bench.submission.again import Repeated, outcomes_of, repeat
from olne_bench.bench.submission.asked import asked, planned_trials
from olne_bench.bench.submission.boards import check_boards
from olne_bench.bench.submission.choose import choose
from olne_bench.bench.submission.drawn import (
    DrawnErrors,
    drawn_errors,
    drawn_plans,
    fixed_scenarios,
)
from olne_bench.bench.submission.fresh import (
    FIRST,
    LEVEL,
    SECOND,
    SUSPICIOUS,
    FreshErrors,
    compare_fresh,
    fresh_trials,
    has_truth,
)
from olne_bench.bench.submission.fresh_draws import (
    FEWEST,
    Machine,
    confirm,
    row_of,
    suspects,
    trial_place,
)
from olne_bench.bench.submission.manifest import PLUGINS, Submission, read_submission
from olne_bench.bench.submission.played import played_study
from olne_bench.bench.submission.rows import (
    Key,
    Rows,
    check_versions,
    check_whole,
    described,
    explain_versions,
    read_rows,
)
from olne_bench.errors import UserError


@dataclass(frozen=True)
class Verdict:
    """The result of checking a submission."""

    rows: int
    repeated: Repeated
    because: str = ""  # which versions differ from those of the rows; empty if none does
    # what fresh draws say of rows that are too good
    implausible: list[Confirmation] = field(default_factory=list)
    fresh: list[FreshErrors] = field(default_factory=list)  # errors with fresh salts
    # errors on drawn truths, where it has fixed ones
    drawn: list[DrawnErrors] = field(default_factory=list)
    fixed: tuple[str, ...] = ()  # scenarios whose truths are fixed, where plugins do not rank
    # a line for each trial that could not be judged
    unjudged: list[str] = field(default_factory=list)

    @property
    def accepted(self) -> bool:
        """Whether something was compared and no check failed."""
        honest = all(one.accepted for one in self.fresh) and all(d.accepted for d in self.drawn)
        plausible = all(one.confirmed for one in self.implausible)
        bad_rows = self.repeated.differing or self.repeated.too_silent or self.unjudged
        refused = bad_rows or not honest or not plausible
        return self.repeated.same > 0 and not refused


@dataclass(frozen=True)
class Limits:
    """How a submission is checked."""

    sample: int | None  # rows of each group to run again; None: as many as are ``needed``
    seed: int  # of the choice of trials
    jobs: int
    memory: int  # limit of each process that runs foreign code [bytes]
    strict: bool = False  # whether rows of other versions are refused


@dataclass(frozen=True)
class _Case:
    """A submission whose files, rows and tables fit each other."""

    submission: Submission
    rows: Rows
    planned: Mapping[Key, Trial]
    study: Study
    metric: MetricDeclaration
    other: set[str]


def verify(folder: Path, limits: Limits) -> Verdict:
    """Check a submission; UserError if it was changed, is not complete or cannot be run here."""
    submission = read_submission(folder)
    rows = read_rows(submission)
    with plugins_alone(submission) as home:
        case = _checked(submission, rows, home)
        because = explain_versions(case.other, submission)
        if case.other and limits.strict:
            raise UserError(
                f"{folder}: its rows are of other versions: {because}; without --strict they may "
                "differ in the last digits"
            )
        return _run(case, limits, because)


def _checked(submission: Submission, rows: Rows, home: Path) -> _Case:
    """All that can be checked without running a trial."""
    parts = asked(submission, home, len(rows.table))
    planned = planned_trials(parts)
    check_whole(rows, planned, submission.folder)
    study = played_study(suite for suite, _, _ in parts)
    other = check_versions(rows, planned, submission)
    check_boards(submission, rows.table, study)
    metric = primary(study.metrics)
    if metric is None:
        raise UserError(f"{submission.folder}: its suite has no metric that ranks estimators")
    return _Case(submission, rows, planned, study, metric, other)


@contextmanager
def plugins_alone(submission: Submission) -> Iterator[Path]:
    """A folder with the plugins only: one must not find its rows, nor that it is being checked.

    Names are as they may be in any run, and so are the times of files.
    """
    with TemporaryDirectory() as made:
        home = Path(made)
        times = _started(submission)
        for place in submission.files:
            if place.startswith(f"{PLUGINS}/"):
                copy = home / place.removeprefix(f"{PLUGINS}/")
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(submission.folder / place, copy)
                os.utime(copy, (times, times))
        yield home


def _started(submission: Submission) -> float:
    try:
        return datetime.fromisoformat(submission.runs[0].started).timestamp()
    except (ValueError, OverflowError, OSError):  # for people only: it may be anything
        return (submission.folder / PLUGINS).stat().st_mtime


def _run(case: _Case, limits: Limits, because: str) -> Verdict:
    rng = np.random.default_rng(limits.seed)
    machine = Machine(limits.jobs, limits.memory, case.submission.folder.resolve())
    chosen = choose(case.planned, case.rows, case.metric, limits.sample, rng)
    repeated = repeat(chosen, case.rows, machine, exact=not case.other)
    trials = list(case.planned.values())
    plugins = list(dict.fromkeys(trial.plugin for trial in trials if trial.plugin))
    fixed = tuple(entry.label for entry in fixed_scenarios(trials)) if plugins else ()
    verdict = Verdict(len(trials), repeated, because, fixed=fixed)
    if repeated.differing or not plugins:
        return verdict
    verdict.implausible.extend(_implausible(case, machine))
    own = [_Own(case, plugin, LEVEL / len(plugins), rng) for plugin in plugins]
    plans = drawn_plans(trials, rng)
    # In one run, as its processes take seconds to start.
    asked = [t for part in (*(one.first for one in own), *(p.trials for p in plans)) for t in part]
    outcomes = outcomes_of(asked, machine)
    verdict.fresh.extend(_fresh(one, outcomes, machine, verdict.unjudged) for one in own)
    errors = _submitted_errors(case, (p.own.key for plan in plans for p in plan.fixed))
    for plan in plans:
        verdict.drawn.append(drawn_errors(plan, outcomes, errors, case.metric.name))
    return verdict


def _implausible(case: _Case, machine: Machine) -> Iterator[Confirmation]:
    """What fresh draws say of plugins' rows that are too good for their noise."""
    planned = {
        trial_place((t.scenario.label, t.sensor.label, t.estimator.label), t.sigma): t
        for t in case.planned.values()
    }
    for suspect in suspects(case.rows.table, case.study, planned):
        if suspect.trials[0].plugin:
            yield confirm(suspect, FEWEST, machine)


class _Own:
    """Submitted rows of a plugin, and trials with fresh salts: a first test, and a second one."""

    def __init__(self, case: _Case, plugin: str, level: float, rng: np.random.Generator) -> None:
        own = [trial for trial in case.planned.values() if trial.plugin == plugin]
        self.plugin, self.metric, self.level = plugin, case.metric, level
        self.rows = case.rows.table.iloc[[case.rows.places[trial.key] for trial in own]]
        played = [t for t, there in zip(own, has_truth(self.rows), strict=True) if there]
        self.first = fresh_trials(played, FIRST, SUSPICIOUS, rng)
        self.second = fresh_trials(played, SECOND, level, rng)
        if not self.second:  # nothing could decide
            self.first = []
        self.families = [s for s in case.study.scenarios if case.study.is_family(s)]

    def compared(
        self, trials: Sequence[Trial], outcomes: Mapping[Key, Outcome], level: float
    ) -> FreshErrors:
        """Its errors with fresh salts."""
        if not trials:
            return FreshErrors(self.plugin, self.metric.name, 0, np.nan, np.nan, 1.0, decides=False)
        table = pd.DataFrame([row_of(trial, outcomes[trial.key]) for trial in trials])
        return compare_fresh(self.rows, table, self.metric, self.families, level)


def _fresh(
    own: _Own, outcomes: Mapping[Key, Outcome], machine: Machine, unjudged: list[str]
) -> FreshErrors:
    """Errors of a plugin with fresh salts: of its first test, or of its second one if need be."""
    unjudged += _unjudged(own.first, outcomes)
    found = own.compared(own.first, outcomes, SUSPICIOUS)
    if found.accepted or not own.first:
        return found
    again = outcomes_of(own.second, machine)
    unjudged += _unjudged(own.second, again)
    return own.compared(own.second, again, own.level)


def _unjudged(trials: Iterable[Trial], outcomes: Mapping[Key, Outcome]) -> list[str]:
    return [
        f"{described(trial.labels)}, with a fresh salt: {outcomes[trial.key].message}"
        for trial in trials
        if outcomes[trial.key].status == "harness_error"
    ]


def _submitted_errors(case: _Case, keys: Iterable[Key]) -> dict[Key, float]:
    distinct = list(dict.fromkeys(keys))
    table = case.rows.table.iloc[[case.rows.places[key] for key in distinct]]
    return dict(zip(distinct, errors_of(table, case.metric).tolist(), strict=True))
