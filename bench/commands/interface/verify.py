"""``olne-bench verify``: check submissions."""

from typing import Any

import click

from olne_bench.bench.commands.options import JOBS, PATH, memory_option


@click.command()
@click.argument("folders", metavar="FOLDER...", nargs=-1, required=True, type=PATH)
@click.option(
    "--sample",
    type=click.IntRange(1, 10**6),
    help="Number of rows of each plugin, and of all built-in estimators, to run again. "
    "Default: as many as find 5 % forged ones with 97 %, and the most suspicious.",
)
@click.option("--seed", type=click.IntRange(0), help="Seed of the choice of trials, to repeat it.")
@click.option("--strict", is_flag=True, help="Refuse rows of other versions of code or libraries.")
@click.option("--jobs", type=JOBS, default=2, show_default=True)
@memory_option("Memory that a worker process may use.")
@click.option("--page", type=PATH, help="New .html file for a page of the accepted submissions.")
def verify(**given: Any) -> None:
    """Check the submissions in FOLDER..., as 'olne-bench submit' packs them.

    A sample of the rows is run again and must come out the same: bit by bit, or, with other
    versions of code or libraries, within 0.1 %. Plugins are run with fresh salts, too: they are
    refused if their errors there are significantly larger than the submitted ones. Where truths
    are fixed, they are run on drawn ones, as constants are known to everyone.

    Exit code 0 if all are accepted, 1 if one is not, 2 on bad input, such as a changed file.
    """
    from olne_bench.bench.commands.verify import verify as work

    work(**given)
