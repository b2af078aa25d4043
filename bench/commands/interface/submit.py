"""``olne-bench submit``: pack a run for a pull request."""

from typing import Any

import click

from olne_bench.bench.commands.defaults import SUBMISSIONS
from olne_bench.bench.commands.options import PATH


@click.command()
@click.argument("folder", metavar="RUN", type=PATH)
@click.option("--name", help="Name of the submission. Default: that of the run folder.")
@click.option("--out", type=PATH, help=f"New folder. Default: {SUBMISSIONS}/NAME.")
def submit(**given: Any) -> None:
    """Pack the run in RUN for a pull request.

    The folder holds the rows, the leaderboard, the source of the estimators that are plugins, and
    their provenance: suite with salt, versions, commit, and hashes of the files. Every trial must
    have been run with the present code. 'olne-bench verify' checks the folder.
    """
    from olne_bench.bench.commands.submit import submit as work

    work(**given)
