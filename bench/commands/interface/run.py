"""``olne-bench run``: run a suite, or continue an interrupted run."""

from typing import Any

import click

from olne_bench.bench.commands.interface.study_options import study_options
from olne_bench.bench.report.formats import FORMATS


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
    """Run SUITE, a name or a TOML file. Options select a part of it, or change it.

    Scenarios, sensors, estimators and noise levels that the suite does not have replace those that
    it has. The changed suite has another name, and needs a run folder of its own. Trials that are
    in the run folder are not run again, unless the code of their scenario, sensor, estimator or
    scoring has changed.
    """
    from olne_bench.bench.commands.run import run as work

    work(suite, **options)
