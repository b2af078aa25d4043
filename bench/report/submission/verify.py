"""Run a sample of a submission's trials again, as they are and with a fresh salt."""

import os
import secrets
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd

from olne_bench.bench.plan.learn import learn
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.select import select
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.plan.trial import Trial, in_order_of_plugins
from olne_bench.bench.report.measures import primary
from olne_bench.bench.report.statistics.attempts import FLOOR, weighed
from olne_bench.bench.report.study import Study, study_of
from olne_bench.bench.report.submission.fresh import FreshErrors, compare_fresh
from olne_bench.bench.report.submission.manifest import (
    LEADERBOARD,
    PLUGINS,
    Submission,
    read_submission,
)
from olne_bench.bench.report.submission.rows import (
    Rows,
    check_whole,
    described,
    difference,
    explain_versions,
    other_versions,
    read_rows,
    timed_out,
)
from olne_bench.bench.report.tables import tabulate
from olne_bench.bench.run.describing import describe_all
from olne_bench.bench.run.executor import run_trials
from olne_bench.errors import UserError

Key = tuple[str, ...]

#: Tolerance of tables, whose last digits depend on the versions of libraries.
_TABLE_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Verdict:
    """The result of checking a submission.

    Attributes:
        rows: number of its rows.
        identical: number of rows that were run again and are the same, bit by bit.
        differing: one line for each row that is not.
        timed_out: number of rows that were run again but not compared, as a time limit was reached.
        other_versions: number of rows that this code cannot repeat bit by bit.
        because: which versions differ from those of the rows; empty if none does.
        fresh: errors with a fresh salt, by estimator.
        unjudged: one line for each trial with a fresh salt that could not be judged.
    """

    rows: int
    identical: int
    differing: list[str]
    timed_out: int
    other_versions: int
    because: str
    fresh: list[FreshErrors]
    unjudged: list[str]

    @property
    def accepted(self) -> bool:
        """Whether something was compared and no check failed."""
        told = self.identical > 0 or any(one.decides for one in self.fresh)
        refused = self.differing or self.unjudged or not all(f.accepted for f in self.fresh)
        return told and not refused


@dataclass(frozen=True)
class Limits:
    """How a submission is checked.

    Attributes:
        sample: number of trials to run again, and number to run with a fresh salt.
        seed: seed of the choice of trials.
        jobs: number of trials at the same time.
        memory: memory limit [bytes] of each process that runs foreign code.
        strict: whether rows of other versions are refused.
    """

    sample: int
    seed: int
    jobs: int
    memory: int
    strict: bool = False


def verify(folder: Path, limits: Limits) -> Verdict:
    """Check a submission.

    Args:
        folder: folder of the submission.
        limits: limits of the check.

    Raises:
        UserError: if it is not a submission, was changed, is not complete, cannot be run here, or,
            if the check is strict, has rows of other versions.
    """
    submission = read_submission(folder)
    rows = read_rows(submission)
    with _away_from_rows(submission) as home:
        suites = [_learnt(suite, folder) for suite in submission.suites(home)]
        planned = _planned(submission, suites)
        check_whole(rows, planned, folder)
        study = study_of(suites)
        _check_leaderboard(submission, rows, study)
        other = {key: other_versions(rows.by_key[key], trial) for key, trial in planned.items()}
        number = sum(bool(kinds) for kinds in other.values())
        because = explain_versions((kind for kinds in other.values() for kind in kinds), submission)
        if number and limits.strict:
            raise UserError(
                f"{folder}: {number} of {len(planned)} rows are of other versions: {because}; "
                "without --strict they are judged by a fresh salt alone"
            )
        rng = np.random.default_rng(limits.seed)
        repeated = _sample([t for key, t in planned.items() if not other[key]], limits.sample, rng)
        fresh = _with_fresh_salt(list(planned.values()), limits.sample, rng)
        outcomes = _run([*repeated, *fresh], limits, folder)
    found = _as_they_are(rows, repeated, outcomes)
    errors, unjudged = _fresh_errors(rows, fresh, outcomes, study)
    return Verdict(len(planned), *found, number, because, errors, unjudged)


@contextmanager
def _away_from_rows(submission: Submission) -> Iterator[Path]:
    """A folder with the plugins only: a plugin must not find its rows beside itself."""
    with TemporaryDirectory(prefix="olne-verify-") as made:
        home = Path(made)
        for place in submission.files:
            if place.startswith(f"{PLUGINS}/"):
                copy = home / place
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(submission.folder / place, copy)
        yield home


def _learnt(suite: Suite, folder: Path) -> Suite:
    """The suite with the present descriptions of its plugins instead of the stored ones."""
    try:
        return learn(suite, (), partial(describe_all, hidden=folder))
    except UserError as error:
        raise UserError(f"{folder}: {error}") from error


def _planned(submission: Submission, suites: list[Suite]) -> dict[Key, Trial]:
    """All trials that the runs were asked for, in an order in which they run fast."""
    trials: dict[Key, Trial] = {}
    for run, suite in zip(submission.runs, suites, strict=True):
        part = select(suite, run.selection)
        for trial in in_order_of_plugins(part, run.seeds):
            trials.setdefault(trial.key, trial)
    return trials


def _check_leaderboard(submission: Submission, rows: Rows, study: Study) -> None:
    """Refuse a leaderboard that does not follow from the rows."""
    place = submission.folder / LEADERBOARD
    try:
        stated = pd.read_csv(place)
    except (OSError, ValueError) as error:
        raise UserError(f"{place} cannot be read: {error}") from error
    made = tabulate(weighed(rows.table), study).leaderboard
    for name in made.columns:
        if name not in stated or len(stated) != len(made):
            raise UserError(f"{place} is not the leaderboard of the rows beside it")
        if not _alike(stated[name], made[name]):
            raise UserError(f"{place} is not the leaderboard of the rows beside it: see {name}")


def _alike(stated: pd.Series, made: pd.Series) -> bool:
    if not pd.api.types.is_numeric_dtype(made):
        return list(stated.astype(str)) == list(made.astype(str))
    there, here = (column.to_numpy(float, na_value=np.nan) for column in (stated, made))
    return np.allclose(there, here, rtol=_TABLE_TOLERANCE, atol=1e-12, equal_nan=True)


def _sample(trials: list[Trial], number: int, rng: np.random.Generator) -> list[Trial]:
    chosen = rng.choice(len(trials), min(number, len(trials)), replace=False)
    return [trials[k] for k in sorted(chosen)]


def _with_fresh_salt(trials: list[Trial], number: int, rng: np.random.Generator) -> list[Trial]:
    """Trials like some of these, with a fresh salt and new seeds.

    They are of estimators that are plugins, if there are any, and have noise or a family's draw.
    """
    salt = secrets.token_hex(16)
    own = [t for t in trials if t.plugin] or [t for t in trials if t.estimator.label != FLOOR]
    drawn = [trial for trial in own if trial.sigma > 0 or trial.scenario.family]
    if not drawn:
        return []
    chosen = rng.choice(len(drawn), number)
    return [replace(drawn[k], salt=salt, seed=seed) for seed, k in enumerate(sorted(chosen))]


def _run(trials: list[Trial], limits: Limits, folder: Path) -> dict[Key, Outcome]:
    ended = run_trials(
        trials,
        jobs=limits.jobs,
        memory=limits.memory,
        hidden=folder.resolve(),
        log=Path(os.devnull),
    )
    return {trial.key: outcome for trial, outcome in ended}


def _as_they_are(
    rows: Rows, trials: list[Trial], outcomes: Mapping[Key, Outcome]
) -> tuple[int, list[str], int]:
    """Number of equal rows, lines on differing rows, and number of rows that were not compared."""
    same, silent, differing = 0, 0, []
    for trial in trials:
        row, outcome = rows.by_key[trial.key], outcomes[trial.key]
        found = difference(row, outcome)
        if found is not None:
            differing.append(f"{described(row)}: {found}")
        elif timed_out(row, outcome):
            silent += 1
        else:
            same += 1
    return same, differing, silent


def _fresh_errors(
    rows: Rows, trials: list[Trial], outcomes: Mapping[Key, Outcome], study: Study
) -> tuple[list[FreshErrors], list[str]]:
    """Errors of trials with a fresh salt, and lines on those that could not be judged."""
    metric = primary(study.metrics)
    if metric is None or not trials:
        return [], []
    table = [t.labels | asdict(outcomes[t.key]) | outcomes[t.key].scores for t in trials]
    unjudged = [
        f"{described(row)}, with a fresh salt: {row['message']}"
        for row in table
        if row["status"] == "harness_error"
    ]
    return compare_fresh(rows.table, pd.DataFrame(table), metric, study), unjudged
