"""``olne-bench gate``: does a run keep the limits of its suite?"""

import math
import sys
from collections.abc import Sequence
from pathlib import Path

import click

from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.report.gate import LimitOutcome, check_limits, missing_trials, task_of
from olne_bench.bench.report.statistics.attempts import weighed
from olne_bench.bench.report.statistics.standing import said_of_standing
from olne_bench.bench.report.study import study_in
from olne_bench.bench.report.tables import tabulate
from olne_bench.bench.run.describe_plugins import describe_all
from olne_bench.bench.run.provenance import Provenance
from olne_bench.bench.run.resume import last_suite
from olne_bench.bench.run.store import read_store
from olne_bench.errors import UserError


def gate(folder: Path, suite: str | None) -> None:
    """Check the run in FOLDER against the limits in the [gate] table of its suite."""
    with read_store(folder) as store:
        trials, runs = store.frame(), store.runs()
        study = study_in(folder, store)
    if trials.empty:
        raise UserError(f"the run in {folder} has no finished trial yet")
    last = last_suite(runs, folder)
    source = last if suite is None else load_suite(suite, describe=describe_all)
    _refuse_no_limits(source)
    board = tabulate(weighed(trials), study).leaderboard
    outcomes = check_limits(board, source.gate, study)
    # The run has to be finished whatever the limits are.
    unfinished = missing_trials(trials, [task_of(run) for run in runs])
    for outcome in outcomes:
        click.echo(_line(outcome))
    for line in said_of_standing(board):
        click.echo(f"note: {line}", err=True)
    for line in unfinished:
        click.echo(f"FAILS  {line}")
    failed = sum(not outcome.passed for outcome in outcomes)
    click.echo(
        f"{len(outcomes) - failed} of {len(outcomes)} limits hold"
        + (", but the run is not finished" if unfinished else "")
        + _parts(runs)
    )
    sys.exit(1 if failed or unfinished else 0)


def _refuse_no_limits(suite: Suite) -> None:
    if not suite.gate:
        raise UserError(
            f"suite {suite.name!r} has no [gate] table; it would have limits by estimator, such "
            f"as [gate.{suite.estimators[0].label}] with position_error = 0.1"
        )


def _line(outcome: LimitOutcome) -> str:
    value = "∞" if math.isinf(outcome.value) else f"{outcome.value:.4g}"
    return (
        f"{'holds' if outcome.passed else 'FAILS'}  {outcome.estimator}, {outcome.scenario}, "
        f"{outcome.sensor}: {outcome.limit} {value}  (at most {outcome.bound:g})"
    )


def _parts(runs: Sequence[Provenance]) -> str:
    """Which parts of the suite were run; empty if all were."""
    selections = [str(run.selection) for run in runs]
    if "" in selections:
        return ""
    return f"; only a part of the suite was run: {'; '.join(dict.fromkeys(selections))}"
