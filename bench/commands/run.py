"""``olne-bench run``: run a suite, or continue an interrupted run."""

import os
import signal
import sys
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import click
from tqdm import tqdm

from olne_bench.bench.commands.options import name_and_value
from olne_bench.bench.commands.report import show_report
from olne_bench.bench.plan.kinds import StudyKind
from olne_bench.bench.plan.outcome import FAILURES
from olne_bench.bench.plan.select import Selection
from olne_bench.bench.plan.trial import Trial
from olne_bench.bench.process import nursery
from olne_bench.bench.report.formats import read_formats
from olne_bench.bench.run.interrupt import stop_request
from olne_bench.bench.run.store import Store, open_store
from olne_bench.bench.run.study import Machine, Wanted, begin, load_study, run_stored
from olne_bench.plugins import METRIC, is_built_in

#: Number of harness errors shown at the end.
_SHOWN_FAULTS = 5
#: What writes reports, whose import takes a second.
_WRITER = "olne_bench.bench.report.write"


def run(
    suite: str,
    out: Path,
    jobs: int,
    dask: str | None,
    memory: float,
    figures: bool,
    report: bool,
    formats: str,
    **asked: Any,
) -> None:
    """Run SUITE, a name or a TOML file."""
    drawn = read_formats(formats) if figures else ()
    wanted, machine = _wanted(suite, **asked), Machine(out, jobs, dask, memory)
    whole = load_study(wanted, machine)
    foreign = [one.column for one in whole.metrics if not is_built_in(METRIC, one.name)]
    if foreign and whole.kind != "trials":
        _note(f"note: a study of {whole.kind} has errors of its own; ignored: {', '.join(foreign)}")
    with open_store(out) as store:
        todo = begin(whole, wanted, machine, store)
        if todo.draws is not None:
            _note(f"solved draws are read from {todo.draws}")
        if todo.number < todo.total:
            _note(f"{todo.total - todo.number} of {todo.total} trials are done already")
        interrupted = run_all(todo.trials, todo.number, store, machine, reported=report)
    if interrupted is not None:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(128 + interrupted)  # Dask would wait for its workers first
    if report:
        show_report(out, drawn)
    else:
        click.echo(f"{out}: to write its tables and page, run 'olne-bench report {out}'")


def _wanted(
    suite: str,
    scenario: tuple[str, ...],
    sensor: tuple[str, ...],
    estimator: tuple[str, ...],
    sigma: tuple[float, ...],
    seeds: int | None,
    plugin: tuple[str, ...],
    salt: str | None,
    retry: tuple[str, ...],
    kind: StudyKind | None,
    rule: tuple[str, ...],
) -> Wanted:
    """What is asked of the study; ``select`` checks the names."""
    chosen = Selection.model_construct(
        scenarios=scenario, sensors=sensor, sigmas=sigma, estimators=estimator, seeds=seeds
    )
    rules = dict(name_and_value("--rule", text, "lag=8") for text in rule)
    return Wanted(suite, chosen, plugin, salt, retry, kind, rules)


def _note(line: str) -> None:
    click.echo(line, err=True)


def run_all(
    todo: Iterable[Trial], number: int, store: Store, machine: Machine, *, reported: bool = False
) -> signal.Signals | None:
    """Run trials, of which a report may follow, and store them.

    Returns the signal that interrupted them, if any.
    """
    failures: Counter[str] = Counter()
    faults: Counter[str] = Counter()
    with stop_request() as stop:
        stored = 0
        with tqdm(total=number, unit="trial", smoothing=0.05, mininterval=0.5) as bar:
            for outcome in run_stored(todo, machine, store, stop):
                stored += 1
                if stored == 1 and reported:  # its processes are born
                    nursery.meanwhile([_WRITER])
                if outcome.status == "harness_error":
                    faults[outcome.message] += 1
                if outcome.status in (*FAILURES, "harness_error"):
                    failures[outcome.status] += 1
                    bar.set_postfix(failures, refresh=False)
                bar.update()
    show_faults(faults)
    if stop.signal is not None and stored < number:
        _note(
            f"interrupted: {stored} trials of this run are stored in {machine.out}, "
            f"{number - stored} remain; run the same command again to continue"
        )
        return stop.signal
    return None


def show_faults(faults: Counter[str]) -> None:
    """Say which trials the harness could not judge."""
    if not faults:
        return
    _note(
        f"{faults.total()} trials could not be judged (harness_error). They do not count against "
        "any estimator:"
    )
    for message, times in faults.most_common(_SHOWN_FAULTS):
        _note(f"  {times} times: {message[:300]}")
    if len(faults) > _SHOWN_FAULTS:
        _note(f"  and {len(faults) - _SHOWN_FAULTS} other messages")
