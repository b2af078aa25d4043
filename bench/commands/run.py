"""``olne-bench run``: run a suite, or continue an interrupted run."""

import os
import signal
import sys
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import click
from tqdm import tqdm

from olne_bench.bench.commands.options import name_and_value
from olne_bench.bench.commands.report import show_report, worlds_of
from olne_bench.bench.plan.kinds import StudyKind
from olne_bench.bench.plan.outcome import FAILURES
from olne_bench.bench.plan.select import Selection
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.plan.trial import Trial
from olne_bench.bench.report.formats import read_formats
from olne_bench.bench.run.interrupt import stop_request
from olne_bench.bench.run.store import Store, open_store
from olne_bench.bench.run.study import Machine, Wanted, begin, load_study, run_stored
from olne_bench.plugins import METRIC, is_built_in

#: Number of harness errors shown at the end.
_SHOWN_FAULTS = 5


@dataclass(frozen=True, kw_only=True)
class RunOptions(Machine):
    """The options of ``olne-bench run``."""

    suite: str
    retry: tuple[str, ...]
    scenario: tuple[str, ...]
    sensor: tuple[str, ...]
    estimator: tuple[str, ...]
    sigma: tuple[float, ...]
    seeds: int | None
    salt: str | None
    plugin: tuple[str, ...]
    kind: StudyKind | None
    rule: tuple[str, ...]
    figures: bool
    report: bool
    formats: str

    @property
    def selection(self) -> Selection:
        """The selected part of the suite; ``select`` checks its names."""
        return Selection.model_construct(
            scenarios=self.scenario,
            sensors=self.sensor,
            sigmas=self.sigma,
            estimators=self.estimator,
            seeds=self.seeds,
        )

    @property
    def wanted(self) -> Wanted:
        """What is asked of the study."""
        rules = dict(name_and_value("--rule", text, "lag=8") for text in self.rule)
        given = (self.suite, self.selection, self.plugin, self.salt, self.retry)
        return Wanted(*given, self.kind, rules)


def run(suite: str, **options: Any) -> None:
    """Run SUITE, a name or a TOML file."""
    chosen = RunOptions(suite=suite, **options)
    drawn = read_formats(chosen.formats) if chosen.figures else ()
    whole = load_study(chosen.wanted, chosen)
    if ignored := ignored_metrics(whole):
        click.echo(
            f"note: a study of {whole.kind} has errors of its own; ignored: {', '.join(ignored)}",
            err=True,
        )
    with open_store(chosen.out) as store:
        interrupted = go_on(whole, chosen, store)
    leave(interrupted)
    if chosen.report:
        show_report(chosen.out, drawn, loaded=worlds_of(whole))
    else:
        click.echo(
            f"{chosen.out}: to write its tables and page, run 'olne-bench report {chosen.out}'"
        )


def ignored_metrics(suite: Suite) -> list[str]:
    """Metrics of plugins that a suite names and its kind does not compute."""
    if suite.kind == "trials":
        return []
    return [one.column for one in suite.metrics if not is_built_in(METRIC, one.name)]


def leave(interrupted: signal.Signals | None) -> None:
    """End this process at once if a signal has asked for it."""
    if interrupted is not None:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(128 + interrupted)  # Dask would wait for its workers first


def go_on(suite: Suite, options: RunOptions, store: Store) -> signal.Signals | None:
    """Run the trials that the store lacks; return the signal that interrupted them, if any.

    Args:
        suite: the whole suite.
        options: the command's options.
        store: where outcomes go.

    Raises:
        UserError: if the suite does not fit the one that the store was begun with.
    """
    todo = begin(suite, options.wanted, options, store)
    if todo.draws is not None:
        click.echo(f"solved draws are read from {todo.draws}", err=True)
    if todo.number < todo.total:
        click.echo(f"{todo.total - todo.number} of {todo.total} trials are done already", err=True)
    return run_all(todo.trials, todo.number, store, options)


def run_all(
    todo: Iterable[Trial], number: int, store: Store, options: Machine
) -> signal.Signals | None:
    """Run trials and store them; return the signal that interrupted them, if any."""
    failures: Counter[str] = Counter()
    faults: Counter[str] = Counter()
    with stop_request() as stop:
        stored = 0
        with tqdm(total=number, unit="trial", smoothing=0.05, mininterval=0.5) as bar:
            for _, outcome in run_stored(todo, options, store, stop):
                stored += 1
                if outcome.status == "harness_error":
                    faults[outcome.message] += 1
                if outcome.status in (*FAILURES, "harness_error"):
                    failures[outcome.status] += 1
                    bar.set_postfix(failures, refresh=False)
                bar.update()
    show_faults(faults)
    if stop.signal is not None and stored < number:
        click.echo(
            f"interrupted: {stored} trials of this run are stored in {options.out}, "
            f"{number - stored} remain; run the same command again to continue",
            err=True,
        )
        return stop.signal
    return None


def show_faults(faults: Counter[str]) -> None:
    """Say which trials the harness could not judge."""
    if not faults:
        return
    click.echo(
        f"{faults.total()} trials could not be judged (harness_error). They do not count against "
        "any estimator:",
        err=True,
    )
    for message, times in faults.most_common(_SHOWN_FAULTS):
        click.echo(f"  {times} times: {message[:300]}", err=True)
    if len(faults) > _SHOWN_FAULTS:
        click.echo(f"  and {len(faults) - _SHOWN_FAULTS} other messages", err=True)
