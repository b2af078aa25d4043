"""``olne-bench run``: run a suite, or continue an interrupted run."""

from dataclasses import dataclass
from functools import partial
from typing import Any

import click

from olne_bench.bench.commands.going_on import StudyOptions, go_on, leave, study_options
from olne_bench.bench.commands.report import show_report, worlds_of
from olne_bench.bench.plan.check import check_gate
from olne_bench.bench.plan.draws import draws_source
from olne_bench.bench.plan.load import load_suite, suite_text
from olne_bench.bench.plan.salt import check_salt
from olne_bench.bench.plan.select import select
from olne_bench.bench.report.formats import FORMATS, read_formats
from olne_bench.bench.run.cluster import check_cluster
from olne_bench.bench.run.describing import describe_all
from olne_bench.bench.run.excluding import check_priors
from olne_bench.bench.run.fitting import check_fit
from olne_bench.bench.run.store import open_store


@dataclass(frozen=True)
class RunOptions(StudyOptions):
    """The options of ``olne-bench run``."""

    report: bool
    formats: str


@click.command()
@click.argument("suite")
@study_options
@click.option(
    "--report/--no-report",
    default=True,
    show_default=True,
    help="Write tables, page and figures at the end; 'olne-bench report' writes them later.",
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
        interrupted = go_on(whole, text, chosen, store)
    leave(interrupted)
    if chosen.report:
        show_report(chosen.out, drawn, loaded=worlds_of(whole))
    else:
        click.echo(
            f"{chosen.out}: to write its tables and page, run 'olne-bench report {chosen.out}'"
        )
