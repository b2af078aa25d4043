"""``olne-bench gate``: is a run good enough?"""

import math
import sys
from pathlib import Path

import click

from olne_bench.bench.commands.options import PATH
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.suite import read_suite_json
from olne_bench.bench.report.gate import Task, check_limits, missing_trials, task_of
from olne_bench.bench.report.statistics.attempts import weighed
from olne_bench.bench.report.study import study_of
from olne_bench.bench.report.tables import tabulate
from olne_bench.bench.run.store import read_store
from olne_bench.errors import UserError


@click.command()
@click.argument("folder", type=PATH)
@click.option("--suite", help="Take the limits of this suite, not those the run was started with.")
def gate(folder: Path, suite: str | None) -> None:
    """Check the run in FOLDER against the [gate] table of its suite.

    Exit code 0 if every limit is kept, 1 if one is not or the run is not finished, 2 on bad input.
    """
    with read_store(folder) as store:
        trials, runs = store.frame(), store.runs()
    if trials.empty:
        raise UserError(f"the run in {folder} has no finished trial yet")
    if suite is None and not runs:
        raise UserError(f"the run in {folder} noted no suite; name one with --suite")
    source = load_suite(suite) if suite is not None else read_suite_json(runs[-1].suite)
    if not source.gate:
        raise UserError(
            f"suite {source.name!r} has no [gate] table; it would have limits by estimator, such "
            f"as [gate.{source.estimators[0].label}] with position_error = 0.1"
        )
    study = study_of([source, *(read_suite_json(run.suite) for run in runs)])
    table = tabulate(weighed(trials), study).leaderboard
    checks = check_limits(table, source.gate, study)
    # Other limits do not make a run whole that is not.
    tasks = [task_of(run) for run in runs] or [Task(source, source.seeds)]
    unfinished = missing_trials(trials, tasks)
    for check in checks:
        value = "∞" if math.isinf(check.value) else f"{check.value:.4g}"
        click.echo(
            f"{'holds' if check.passed else 'FAILS'}  {check.estimator}, {check.scenario}, "
            f"{check.sensor}: {check.limit} {value}  (at most {check.bound:g})"
        )
    for line in unfinished:
        click.echo(f"FAILS  {line}")
    selections = [str(run.selection) for run in runs]
    parts = "" if "" in selections else "; ".join(dict.fromkeys(selections))
    failed = sum(not check.passed for check in checks)
    click.echo(
        f"{len(checks) - failed} of {len(checks)} limits are kept"
        + (", but the run is not finished" if unfinished else "")
        + (f" by the parts that were run: {parts}" if parts else "")
    )
    sys.exit(1 if failed or unfinished else 0)
