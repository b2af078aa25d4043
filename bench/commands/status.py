"""``olne-bench status``: which trials of a run are done, failed, stale or missing."""

from collections import Counter
from collections.abc import Mapping
from math import isnan
from pathlib import Path

import click
import pandas as pd

from olne_bench.bench.plan.suite import Suite, read_suite_json, salt_id
from olne_bench.bench.plan.trial import alike
from olne_bench.bench.run.provenance import Provenance
from olne_bench.bench.run.resume import STATES, Stored, last_suite
from olne_bench.bench.run.store import read_store
from olne_bench.bench.run.time_left import Cost, in_words, processes, time_left
from olne_bench.plugins import PluginError


def status(folder: Path) -> None:
    """Show how far the run in FOLDER is."""
    with read_store(folder) as store:
        runs = store.runs()
        stored, costs = Stored(store.records()), store.costs()
    table, notes = _table(last_suite(runs, folder), stored)
    click.echo(_heading(folder, runs))
    click.echo(table.to_string(index=False))
    for note in notes:
        click.echo(note)
    for line in _time_left(table, costs, runs[-1].executor):
        click.echo(line)
    for hint in _hints(table, runs[-1]):
        click.echo(hint)


def _table(suite: Suite, stored: Stored) -> tuple[pd.DataFrame, list[str]]:
    """One row per scenario and estimator, and a note for each without one."""
    rows, notes = [], []
    for scenario, estimator in suite.pairs():
        part = suite.model_copy(update={"scenarios": (scenario,), "estimators": (estimator,)})
        try:
            found = Counter[str]()
            for trial, seeds in alike(part):
                found += stored.states(trial, seeds)
        except PluginError as error:
            notes.append(f"{estimator.label} on {scenario.label}: not known here: {error}")
            continue
        counts = {state: found[state] for state in STATES}
        rows.append({"scenario": scenario.label, "estimator": estimator.label} | counts)
    return pd.DataFrame(rows, columns=["scenario", "estimator", *STATES]), notes


def _time_left(
    table: pd.DataFrame, costs: Mapping[tuple[str, str], Cost], executor: str
) -> list[str]:
    """One line per estimator with trials that are left, and one for all."""
    places = zip(table["scenario"], table["estimator"], strict=True)
    pending = dict(zip(places, table["missing"] + table["stale"], strict=True))
    left = time_left(pending, costs)
    if not left:
        return []
    width, jobs = max(len(one.estimator) for one in left), processes(executor)
    lines = ["time left in one process:"]
    lines += [
        f"  {one.estimator:{width}}  {in_words(one.seconds):>12} for {one.trials} trials"
        for one in left
    ]
    known = sum(one.seconds for one in left if not isnan(one.seconds))
    whole = f"in all {in_words(known)}" + (f", {in_words(known / jobs)} in {jobs}" * (jobs > 1))
    unknown = [one.estimator for one in left if isnan(one.seconds)]
    lines.append(whole + (f", without {', '.join(unknown)}" if unknown else ""))
    return lines


def _heading(folder: Path, runs: list[Provenance]) -> str:
    last = runs[-1]
    suite = read_suite_json(last.suite)
    commit = f", commit {last.commit[:12]}" if last.commit else ""
    own = "its own" if suite.salt == suite.name else repr(suite.salt)
    release = last.versions.get("olne-bench", "?")
    return (
        f"{folder}: suite {suite.name}, {len(runs)} run{'s' if len(runs) > 1 else ''}, the last "
        f"one of {last.started} on {last.executor}, olne-bench {release}{commit}; "
        f"salt {salt_id(suite.salt)} ({own})"
    )


def _hints(table: pd.DataFrame, last: Provenance) -> list[str]:
    hints = []
    if table["missing"].any() or table["stale"].any():
        hints.append("'olne-bench run' with this --out runs missing and stale trials")
    if table["failed"].any():
        hints.append("'olne-bench run --retry failed' runs failed trials again")
    if table["harness_error"].any():
        hints.append(
            "'olne-bench run --retry harness_error' runs trials again that were not judged"
        )
    if str(last.selection):
        hints.append(f"the last run was of a part of the suite: {last.selection}")
    return hints
