"""Going on with a study: run what its store lacks. ``run`` and ``online`` do it alike."""

import os
import signal
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import click
from tqdm import tqdm

from olne_bench.bench.commands.options import JOBS, PATH, PLUGIN, Command, memory_option
from olne_bench.bench.plan.draws import draws_path, draws_source
from olne_bench.bench.plan.outcome import FAILURES, Outcome
from olne_bench.bench.plan.salt import salted
from olne_bench.bench.plan.select import Selection, select
from olne_bench.bench.plan.suite import Suite, read_suite_json
from olne_bench.bench.plan.trial import Trial, in_order_of_plugins, number_of_trials
from olne_bench.bench.plan.work import W
from olne_bench.bench.run.cluster import run_on_dask
from olne_bench.bench.run.executor import run_trials
from olne_bench.bench.run.interrupt import stop_request
from olne_bench.bench.run.provenance import provenance
from olne_bench.bench.run.resume import RETRIES, Stored, check_same_suite, pending
from olne_bench.bench.run.store import Store

#: File in the run folder for what estimators print.
LOG = "workers.log"
#: Number of harness errors shown at the end.
_SHOWN_FAULTS = 5

#: All trials of a suite, or of its first seeds. A process that ran foreign code serves nothing
#: else, so the order is that of plugins, which needs few processes.
Expand = Callable[[Suite, int | None], Iterator[Trial]]


@dataclass(frozen=True)
class Machine:
    """Where a study runs, and into which folder."""

    out: Path
    jobs: int
    dask: str | None
    memory: float


@dataclass(frozen=True)
class StudyOptions(Machine):
    """The options of commands that run a suite."""

    suite: str
    retry: tuple[str, ...]
    scenario: tuple[str, ...]
    sensor: tuple[str, ...]
    estimator: tuple[str, ...]
    sigma: tuple[float, ...]
    seeds: int | None
    salt: str | None
    plugin: tuple[str, ...]
    figures: bool

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


#: The options of ``Machine`` but the folder.
MACHINE_OPTIONS = (
    click.option(
        "--jobs",
        type=JOBS,
        default=2,
        show_default=True,
        help="Number of trials to run at the same time.",
    ),
    click.option(
        "--dask",
        metavar="ADDRESS",
        help="Dask cluster to run on: tcp://host:8786, or local:N for N workers on this machine.",
    ),
    memory_option("Memory limit of each worker process."),
)
_OPTIONS = (
    click.option(
        "--out",
        type=PATH,
        required=True,
        help="Run folder. An interrupted run continues.",
    ),
    *MACHINE_OPTIONS,
    click.option(
        "--retry",
        type=click.Choice(RETRIES),
        multiple=True,
        help="Run failed trials again: all, or those with this status (repeatable).",
    ),
    click.option("--scenario", multiple=True, help="Only this scenario (repeatable)."),
    click.option("--sensor", multiple=True, help="Only this sensor (repeatable)."),
    click.option("--estimator", multiple=True, help="Only this estimator (repeatable)."),
    click.option("--sigma", type=float, multiple=True, help="Only this noise level (repeatable)."),
    click.option(
        "--seeds", type=click.IntRange(1, 10**8), help="Use only the first noise draws, this many."
    ),
    click.option(
        "--salt",
        metavar="TEXT",
        help="Text that seeds noise and draws; 'fresh' draws a secret one.",
    ),
    click.option(
        "--plugin",
        type=PLUGIN,
        multiple=True,
        metavar="FILE.py[:CLASS]",
        help="Add an estimator, scenario, sensor or metric from a file (repeatable).",
    ),
    click.option(
        "--figures/--no-figures", default=True, show_default=True, help="Draw figures at the end."
    ),
)


def study_options(command: Command) -> Command:
    """The options of ``StudyOptions``, for a command that has the argument ``suite``."""
    return _with(_OPTIONS, command)


def machine_options(command: Command) -> Command:
    """The options of ``Machine``, for a command that has the option ``--out``."""
    return _with(MACHINE_OPTIONS, command)


def _with(options: Sequence[Callable[[Command], Command]], command: Command) -> Command:
    for option in reversed(options):
        command = option(command)
    return command


def leave(interrupted: signal.Signals | None) -> None:
    """End this process at once if a signal has asked for it."""
    if interrupted is not None:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(128 + interrupted)  # Dask would wait for its workers first


def go_on(
    suite: Suite,
    text: str,
    options: StudyOptions,
    store: Store,
    expanded: Expand = in_order_of_plugins,
) -> signal.Signals | None:
    """Run the trials that the store lacks; return the signal that interrupted them, if any.

    Args:
        suite: the whole suite.
        text: text of its file.
        options: the command's options.
        store: where outcomes go.
        expanded: all trials of a part of the suite, for so many seeds.

    Raises:
        UserError: if the suite does not fit the one that the store was begun with.
    """
    runs = store.runs()
    former = read_suite_json(runs[-1].suite) if runs else None
    suite = salted(suite, options.salt, former)
    check_same_suite(suite, runs, options.out)
    part, seeds = select(suite, options.selection), options.seeds
    draws = draws_source(options.suite, suite)
    if draws is not None:
        click.echo(f"solved draws are read from {draws_path(options.suite)}", err=True)
    store.check()  # before trials are run beside damaged rows
    stored, total = Stored(store.records()), number_of_trials(part, seeds)

    def todo() -> Iterator[Trial]:
        own = pending(expanded(part, seeds), stored, options.retry)
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
    store.begin_run(source, expanded(part, 1))
    return run_all(todo(), number, store, options)


def start(
    todo: Iterable[W], options: Machine, stop: Callable[[], bool]
) -> Iterator[tuple[W, Outcome]]:
    """Outcomes of trials, motions or drives, here or on a cluster, as they end."""
    limit, out = int(options.memory * 2**30), options.out.resolve()
    if options.dask:
        return run_on_dask(
            todo, cluster=options.dask, log=out / LOG, memory=limit, hidden=out, stop=stop
        )
    return run_trials(todo, jobs=options.jobs, log=out / LOG, memory=limit, hidden=out, stop=stop)


def run_all(
    todo: Iterable[Trial], number: int, store: Store, options: StudyOptions
) -> signal.Signals | None:
    """Run trials and store them; return the signal that interrupted them, if any."""
    failures: Counter[str] = Counter()
    faults: Counter[str] = Counter()
    with stop_request() as stop:
        stored = 0
        with tqdm(total=number, unit="trial", smoothing=0.05, mininterval=0.5) as bar:
            for trial, outcome in start(todo, options, stop):
                store.add(trial, outcome)
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
