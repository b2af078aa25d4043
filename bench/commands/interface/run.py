"""``olne-bench run``: run a suite, or continue an interrupted run."""

from typing import Any

import click

from olne_bench.bench.commands.options import JOBS, PATH, PLUGIN, memory_option
from olne_bench.bench.plan.outcome import RETRIES
from olne_bench.bench.report.formats import FORMATS


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
@click.option(
    "--scenario",
    multiple=True,
    help="Only this scenario (repeatable).",
)
@click.option("--sensor", multiple=True, help="Only this sensor (repeatable).")
@click.option(
    "--estimator",
    multiple=True,
    help="Only this estimator (repeatable).",
)
@click.option(
    "--sigma",
    type=float,
    multiple=True,
    help="Only this noise level (repeatable).",
)
@click.option(
    "--seeds",
    type=click.IntRange(1, 10**8),
    help="Number of noise draws to use, from the first on.",
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
    "--kind",
    type=click.Choice(("trials", "streams")),
    help="Kind of study to make of the suite: estimates at the end, or after each sample.",
)
@click.option(
    "--rule",
    multiple=True,
    metavar="NAME=VALUE",
    help="Rule that replaces one of the suite, such as lag=8 of streams (repeatable).",
)
@click.option(
    "--figures/--no-figures", default=True, show_default=True, help="Draw figures at the end."
)
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
    """Run SUITE, a name or a TOML file. Options select a part of it, or change it.

    Scenarios, sensors, estimators and noise levels that the suite does not have replace those that
    it has, and so do another kind and rules. The changed suite has another name, and needs a run
    folder of its own. Trials that are in the run folder are not run again, unless the code of their
    scenario, sensor, estimator or scoring has changed.
    """
    from olne_bench.bench.commands.run import run as work

    work(suite, **options)
