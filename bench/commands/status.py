"""``olne-bench status``: what of a run is done, failed, stale or still to do."""

from pathlib import Path

import click
import pandas as pd

from olne_bench.bench.plan.suite import Suite, read_suite_json
from olne_bench.bench.plan.trial import expand
from olne_bench.bench.run.provenance import Provenance
from olne_bench.bench.run.resume import last_suite, progress
from olne_bench.bench.run.store import Record, read_store


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
def status(folder: Path) -> None:
    """Show what the run in FOLDER has done.

    done: with a valid result, or declined by the estimator. failed: without. stale: run with
    other parameters, or other code than the present one, of scenario, estimator or scoring.
    missing: not run.
    """
    with read_store(folder, check=True) as store:
        runs = store.runs()
        records = list(store.records())
    suite = last_suite(runs, folder)
    table, notes = _table(suite, records)
    click.echo(_heading(folder, runs))
    click.echo(table.to_string(index=False))
    for note in notes:
        click.echo(note)
    for hint in _hints(table, runs[-1]):
        click.echo(hint)


def _table(suite: Suite, records: list[Record]) -> tuple[pd.DataFrame, list[str]]:
    """One row per scenario and estimator, and what is to be said about those without one."""
    rows, notes = [], []
    for scenario, estimator in suite.pairs():
        part = suite.model_copy(update={"scenarios": (scenario,), "estimators": (estimator,)})
        try:
            found = progress(expand(part), records)
        except ValueError as error:
            notes.append(f"{estimator.label} on {scenario.label}: not known here: {error}")
            continue
        counts = {name: len(trials) for name, trials in vars(found).items()}
        rows.append({"scenario": scenario.label, "estimator": estimator.label} | counts)
    names = ["scenario", "estimator", "done", "failed", "stale", "missing"]
    return pd.DataFrame(rows, columns=names), notes


def _heading(folder: Path, runs: list[Provenance]) -> str:
    last = runs[-1]
    name = read_suite_json(last.suite).name
    commit = f", commit {last.commit[:12]}" if last.commit else ""
    return (
        f"{folder}: suite {name}, {len(runs)} run{'s' if len(runs) > 1 else ''}, the last one of "
        f"{last.started} on {last.executor}, olne-bench {last.versions.get('olne-bench', '?')}"
        f"{commit}"
    )


def _hints(table: pd.DataFrame, last: Provenance) -> list[str]:
    hints = []
    if table["missing"].any() or table["stale"].any():
        hints.append("'olne-bench run' with this --out runs what is missing or stale")
    if table["failed"].any():
        hints.append("'olne-bench run --retry failed' runs what has failed once more")
    if last.selection:
        hints.append(f"the last run was asked for a part only: {last.selection}")
    return hints
