"""``olne-bench run``: run a suite, or go on with it."""

import os
import shlex
import signal
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import click
from tqdm import tqdm

from olne_bench.bench.commands.options import MEMORY
from olne_bench.bench.commands.report import read_formats, show_report
from olne_bench.bench.plan.suite import check_gate, load_suite, select, suite_file
from olne_bench.bench.plan.trial import Outcome, Trial, expand
from olne_bench.bench.report.figures import FORMATS
from olne_bench.bench.run.cluster import check_cluster, run_on_dask
from olne_bench.bench.run.executor import run_trials
from olne_bench.bench.run.interrupt import stop_request
from olne_bench.bench.run.provenance import provenance
from olne_bench.bench.run.resume import RETRIES, check_same_suite, pending
from olne_bench.bench.run.store import Store, open_store
from olne_bench.errors import UserError

_Run = Callable[[list[Trial], Callable[[], bool]], Iterator[tuple[Trial, Outcome]]]


@click.command()
@click.argument("suite")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    required=True,
    help="Run folder; an interrupted run goes on.",
)
@click.option(
    "--jobs", type=click.IntRange(min=1), default=2, show_default=True, help="Worker processes."
)
@click.option(
    "--dask",
    metavar="ADDRESS",
    help="Run on a Dask cluster, tcp://host:8786, or local:N to try it with N workers.",
)
@click.option(
    "--memory",
    type=MEMORY,
    default=4.0,
    show_default=True,
    metavar="GIB",
    help="Memory that a worker process may use.",
)
@click.option(
    "--retry",
    type=click.Choice(RETRIES),
    multiple=True,
    help="Run finished trials again that failed, or failed in this way (repeatable).",
)
@click.option("--scenario", multiple=True, help="Only this scenario (repeatable).")
@click.option("--view", multiple=True, help="Only this view (repeatable).")
@click.option("--estimator", multiple=True, help="Only this estimator (repeatable).")
@click.option("--sigma", type=float, multiple=True, help="Only this noise level (repeatable).")
@click.option("--seeds", type=click.IntRange(min=1), help="Only the first so many noise draws.")
@click.option(
    "--plugin",
    multiple=True,
    metavar="FILE.py[:CLASS]",
    help="Add an estimator from a file (repeatable).",
)
@click.option(
    "--figures/--no-figures", default=True, show_default=True, help="Draw the figures at the end."
)
@click.option(
    "--formats",
    default="png",
    show_default=True,
    help=f"Formats of the figures, out of {', '.join(FORMATS)}.",
)
def run(
    suite: str,
    out: Path,
    jobs: int,
    dask: str | None,
    memory: float,
    retry: tuple[str, ...],
    scenario: tuple[str, ...],
    view: tuple[str, ...],
    estimator: tuple[str, ...],
    sigma: tuple[float, ...],
    seeds: int | None,
    plugin: tuple[str, ...],
    figures: bool,
    formats: str,
) -> None:
    """Run SUITE, a name or a TOML file, or the part of it that the options select.

    Trials that the run folder holds already, with the present code of scenario, estimator and
    scoring, are not run again.
    """
    drawn = read_formats(formats) if figures else ()
    whole = load_suite(suite, plugin)
    check_gate(whole)
    part = select(whole, scenarios=scenario, views=view, sigmas=sigma, estimators=estimator)
    if seeds is not None and seeds > whole.seeds:
        raise UserError(f"--seeds {seeds}: suite {whole.name!r} has {whole.seeds}")
    if dask is not None:
        check_cluster(dask)
    trials = list(expand(part, seeds))
    source = provenance(
        suite=whole.model_dump_json(),
        suite_text=suite_file(suite).read_text(encoding="utf-8"),
        selection=_selection(scenario, view, estimator, sigma, seeds),
        seeds=seeds or whole.seeds,
        executor=f"dask {dask}" if dask else f"{jobs} local processes",
    )
    limit, log = int(memory * 2**30), out / "workers.log"

    def start(todo: list[Trial], stop: Callable[[], bool]) -> Iterator[tuple[Trial, Outcome]]:
        if dask:
            return run_on_dask(todo, cluster=dask, log=log, memory=limit, stop=stop)
        return run_trials(todo, jobs=jobs, log=log, memory=limit, stop=stop)

    with open_store(out) as store:
        check_same_suite(whole, store.runs(), out)
        todo = pending(trials, store.records(), retry)
        # A process that has run foreign code is not given to others: so there are few changes.
        todo.sort(key=lambda trial: trial.plugin)
        if len(todo) < len(trials):
            done = len(trials) - len(todo)
            click.echo(f"{done} of {len(trials)} trials are done already", err=True)
        store.begin_run(source, trials)
        interrupted = _run_all(todo, store, start, out)
    if interrupted is not None:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(128 + interrupted)  # Dask would wait for its workers first
    show_report(out, drawn)


def _run_all(todo: list[Trial], store: Store, start: _Run, out: Path) -> signal.Signals | None:
    """Run trials and store them; returns the signal if one came before all were done."""
    failures: Counter[str] = Counter()
    with stop_request() as stop:
        stored = 0
        with tqdm(total=len(todo), unit="trial", smoothing=0.05, mininterval=0.5) as bar:
            for trial, outcome in start(todo, stop):
                store.add(trial, outcome)
                stored += 1
                if outcome.status not in ("ok", "skipped"):
                    failures[outcome.status] += 1
                    bar.set_postfix(failures, refresh=False)
                bar.update()
    if stop.signal is not None and stored < len(todo):
        click.echo(
            f"interrupted: {stored} trials of this run are stored in {out}, {len(todo) - stored} "
            "are to do; run the same command again to go on",
            err=True,
        )
        return stop.signal
    return None


def _selection(
    scenarios: tuple[str, ...],
    views: tuple[str, ...],
    estimators: tuple[str, ...],
    sigmas: tuple[float, ...],
    seeds: int | None,
) -> str:
    """What was asked of the suite, as it would be said on a command line."""
    chosen = {"scenario": scenarios, "view": views, "estimator": estimators, "sigma": sigmas}
    words = [word for name, values in chosen.items() for v in values for word in (f"--{name}", v)]
    if seeds is not None:
        words += ["--seeds", seeds]
    return shlex.join(str(word) for word in words)
