"""``olne-bench run``: run a suite, or continue an interrupted run."""

import os
import signal
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import click
from tqdm import tqdm

from olne_bench.bench.commands.options import JOBS, PATH, PLUGIN, memory_option
from olne_bench.bench.commands.report import show_report
from olne_bench.bench.plan.check import check_gate
from olne_bench.bench.plan.draws import draws_path, draws_source
from olne_bench.bench.plan.load import load_suite, suite_text
from olne_bench.bench.plan.outcome import FAILURES, Outcome
from olne_bench.bench.plan.salt import check_salt, salted
from olne_bench.bench.plan.select import Selection, select
from olne_bench.bench.plan.suite import Suite, read_suite_json
from olne_bench.bench.plan.trial import Trial, expand, in_order_of_plugins, number_of_trials
from olne_bench.bench.report.formats import FORMATS, read_formats
from olne_bench.bench.run.cluster import check_cluster, run_on_dask
from olne_bench.bench.run.describing import describe_all
from olne_bench.bench.run.excluding import check_priors
from olne_bench.bench.run.executor import run_trials
from olne_bench.bench.run.fitting import check_fit
from olne_bench.bench.run.interrupt import stop_request
from olne_bench.bench.run.provenance import provenance
from olne_bench.bench.run.resume import RETRIES, Stored, check_same_suite, pending
from olne_bench.bench.run.store import Store, open_store

#: File in the run folder for what estimators print.
LOG = "workers.log"
#: Number of harness errors shown at the end.
_SHOWN_FAULTS = 5


@dataclass(frozen=True)
class RunOptions:
    """The options of ``olne-bench run``."""

    suite: str
    out: Path
    jobs: int
    dask: str | None
    memory: float
    retry: tuple[str, ...]
    scenario: tuple[str, ...]
    sensor: tuple[str, ...]
    estimator: tuple[str, ...]
    sigma: tuple[float, ...]
    seeds: int | None
    salt: str | None
    plugin: tuple[str, ...]
    report: bool
    figures: bool
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


@click.command()
@click.argument("suite")
@click.option(
    "--out",
    type=PATH,
    required=True,
    help="Run folder. An interrupted run continues.",
)
@click.option(
    "--jobs",
    type=JOBS,
    default=2,
    show_default=True,
    help="Number of trials to run at the same time.",
)
@click.option(
    "--dask",
    metavar="ADDRESS",
    help="Dask cluster to run on: tcp://host:8786, or local:N for N workers on this machine.",
)
@memory_option("Memory limit of each worker process.")
@click.option(
    "--retry",
    type=click.Choice(RETRIES),
    multiple=True,
    help="Run failed trials again: all, or those with this status (repeatable).",
)
@click.option("--scenario", multiple=True, help="Only this scenario (repeatable).")
@click.option("--sensor", multiple=True, help="Only this sensor (repeatable).")
@click.option("--estimator", multiple=True, help="Only this estimator (repeatable).")
@click.option("--sigma", type=float, multiple=True, help="Only this noise level (repeatable).")
@click.option(
    "--seeds", type=click.IntRange(1, 10**8), help="Use only the first noise draws, this many."
)
@click.option(
    "--salt",
    metavar="TEXT",
    help="Text that seeds noise and draws; 'fresh' draws a secret one.",
)
@click.option(
    "--plugin",
    type=PLUGIN,
    multiple=True,
    metavar="FILE.py[:CLASS]",
    help="Add an estimator, scenario, sensor or metric from a file (repeatable).",
)
@click.option(
    "--report/--no-report",
    default=True,
    show_default=True,
    help="Write tables, page and figures at the end; 'olne-bench report' writes them later.",
)
@click.option(
    "--figures/--no-figures", default=True, show_default=True, help="Draw figures at the end."
)
@click.option(
    "--formats",
    default="png",
    show_default=True,
    help=f"Formats of the figures: {', '.join(FORMATS)}.",
)
def run(suite: str, **options: Any) -> None:
    """Run SUITE, a name or a TOML file. Options select a part of it.

    Trials that are in the run folder are not run again, unless the code of their scenario, sensor,
    estimator or scoring has changed.
    """
    chosen = RunOptions(suite=suite, **options)
    drawn = read_formats(chosen.formats) if chosen.figures else ()
    check_salt(chosen.salt)
    text = suite_text(suite)
    whole = load_suite(suite, chosen.plugin, partial(describe_all, hidden=chosen.out))
    check_gate(whole)
    draws_source(suite, whole)  # refused before anything is written
    part = select(whole, chosen.selection)
    check_fit(part, chosen.out)
    check_priors(part, chosen.out)
    if chosen.dask is not None:
        check_cluster(chosen.dask)
    with open_store(chosen.out) as store:
        interrupted = _go_on(whole, text, chosen, store)
    if interrupted is not None:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(128 + interrupted)  # Dask would wait for its workers first
    if chosen.report:
        show_report(chosen.out, drawn)
    else:
        click.echo(
            f"{chosen.out}: to write its tables and page, run 'olne-bench report {chosen.out}'"
        )


def _go_on(suite: Suite, text: str, options: RunOptions, store: Store) -> signal.Signals | None:
    """Run the trials that the store lacks; return the signal that interrupted them, if any."""
    runs = store.runs()
    former = read_suite_json(runs[-1].suite) if runs else None
    suite = salted(suite, options.salt, former)
    check_same_suite(suite, runs, options.out)
    part, seeds = select(suite, options.selection), options.seeds
    draws = draws_source(options.suite, suite)
    if draws is not None:
        click.echo(f"solved draws are read from {draws_path(options.suite)}", err=True)
    stored, total = Stored(store.records()), number_of_trials(part, seeds)

    def todo() -> Iterator[Trial]:
        # A process that ran foreign code serves nothing else. This order needs few processes.
        own = pending(in_order_of_plugins(part, seeds), stored, options.retry)
        return (replace(trial, draws=draws) for trial in own)

    number = sum(1 for _ in todo()) if runs else total
    if number < total:
        click.echo(f"{total - number} of {total} trials are done already", err=True)
    source = provenance(
        suite=suite.model_dump_json(),
        suite_text=text,
        selection=options.selection,
        seeds=seeds or suite.seeds,
        executor=f"dask {options.dask}" if options.dask else f"{options.jobs} local processes",
    )
    store.begin_run(source, expand(part, seeds=1))
    return _run_all(todo(), number, store, options)


def _start(
    todo: Iterable[Trial], options: RunOptions, stop: Callable[[], bool]
) -> Iterator[tuple[Trial, Outcome]]:
    limit, out = int(options.memory * 2**30), options.out.resolve()
    if options.dask:
        return run_on_dask(
            todo, cluster=options.dask, log=out / LOG, memory=limit, hidden=out, stop=stop
        )
    return run_trials(todo, jobs=options.jobs, log=out / LOG, memory=limit, hidden=out, stop=stop)


def _run_all(
    todo: Iterable[Trial], number: int, store: Store, options: RunOptions
) -> signal.Signals | None:
    """Run trials and store them; return the signal that interrupted them, if any."""
    failures: Counter[str] = Counter()
    faults: Counter[str] = Counter()
    with stop_request() as stop:
        stored = 0
        with tqdm(total=number, unit="trial", smoothing=0.05, mininterval=0.5) as bar:
            for trial, outcome in _start(todo, options, stop):
                store.add(trial, outcome)
                stored += 1
                if outcome.status == "harness_error":
                    faults[outcome.message] += 1
                if outcome.status in (*FAILURES, "harness_error"):
                    failures[outcome.status] += 1
                    bar.set_postfix(failures, refresh=False)
                bar.update()
    _show_faults(faults)
    if stop.signal is not None and stored < number:
        click.echo(
            f"interrupted: {stored} trials of this run are stored in {options.out}, "
            f"{number - stored} remain; run the same command again to continue",
            err=True,
        )
        return stop.signal
    return None


def _show_faults(faults: Counter[str]) -> None:
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
