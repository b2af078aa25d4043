"""``olne-bench confirm``: run fresh draws where rows are implausible."""

import sys
from dataclasses import replace
from pathlib import Path

import click

from olne_bench.bench.plan.suite import Suite, read_suite_json
from olne_bench.bench.plan.trial import Trial, expand
from olne_bench.bench.report.confirmations import Confirmation, write_confirmations
from olne_bench.bench.report.study import study_in
from olne_bench.bench.run.store import Store, read_store
from olne_bench.bench.submission.fresh_draws import Machine, Suspect, suspects, trial_place
from olne_bench.bench.submission.fresh_draws import confirm as run_fresh
from olne_bench.errors import UserError


def confirm(folder: Path, trials: int, jobs: int, memory: float) -> None:
    """Run fresh draws where rows of the run in RUN are implausible."""
    with read_store(folder) as store:
        found = _suspects(folder, store)
    if not found:
        click.echo(f"{folder}: no row is implausible")
        return
    machine = Machine(jobs, int(memory * 2**30), folder.resolve())
    said = []
    for suspect in found:
        said.append(run_fresh(suspect, trials, machine))
        write_confirmations(folder, said)  # one by one, as each may take minutes
        click.echo(_line(said[-1]))
    click.echo(f"to write the tables of the run again: olne-bench report {folder}")
    sys.exit(0 if all(one.confirmed for one in said) else 1)


def _suspects(folder: Path, store: Store) -> list[Suspect]:
    runs, table = store.runs(), store.frame()
    if table.empty or not runs:
        raise UserError(f"the run in {folder} has no finished trial yet")
    suites = [read_suite_json(run.suite) for run in runs]
    planned = {place: trial for suite in suites for place, trial in _planned(suite).items()}
    found = suspects(table, study_in(folder, store), planned)
    code = store.current_code()
    for first in (suspect.trials[0] for suspect in found):
        labels = first.labels
        place = labels["scenario"], labels["sensor"], labels["estimator"]
        if code.get(place) != (labels["parameters"], first.versions):
            raise UserError(
                f"rows of {', '.join(place)} in {folder} were run with other code than the present "
                "one: the same 'olne-bench run' command runs them again"
            )
    return found


def _planned(suite: Suite) -> dict[tuple[str, ...], Trial]:
    """A trial of each scenario, sensor, noise level and estimator."""
    found = {}
    for trial in expand(suite, 1):
        place = trial.scenario.label, trial.sensor.label, trial.estimator.label
        found[trial_place(place, trial.sigma)] = replace(trial, draws=None)
    return found


def _line(one: Confirmation) -> str:
    place = f"{one.estimator} in {one.scenario}, {one.sensor}"
    return (
        f"{place}: {one.text} ({one.as_small} of {one.trials} fresh errors are as small as half of "
        f"the {one.rows} implausible ones)"
    )
