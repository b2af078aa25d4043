"""``olne-bench confirm``: run fresh draws where rows are implausible."""

from typing import Any

import click

from olne_bench.bench.commands.options import JOBS, PATH, memory_option

#: Repeats ``report.fresh_draws.FEWEST``, whose import is slow.
FEWEST = 20


@click.command()
@click.argument("folder", metavar="RUN", type=PATH)
@click.option(
    "--trials",
    type=click.IntRange(FEWEST, 10**6),
    default=FEWEST,
    show_default=True,
    help="Number of fresh trials for each estimator, scenario and sensor.",
)
@click.option("--jobs", type=JOBS, default=2, show_default=True)
@memory_option("Memory limit of each worker process.")
def confirm(**given: Any) -> None:
    """Run fresh draws where rows of the run in RUN are implausible.

    Such rows have errors far below the statistical limit of their trial, and their estimator has no
    rank there. Fresh trials have other draws and other noise for each noise level and sensor. If
    their errors are as small, the estimator ranks: 'olne-bench report' shows it.

    Exit code 0 if all are confirmed, or nothing is implausible, 1 if one is not, 2 on bad input.
    """
    from olne_bench.bench.commands.confirm import confirm as work

    work(**given)
