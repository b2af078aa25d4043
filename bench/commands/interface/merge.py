"""``olne-bench merge``: merge two runs into one."""

from typing import Any

import click

from olne_bench.bench.commands.options import PATH


@click.command()
@click.argument("first", type=PATH)
@click.argument("second", type=PATH)
@click.option(
    "--out", type=PATH, help="New run folder for the result. Without it, FIRST gets the rows."
)
def merge(**given: Any) -> None:
    """Add the trials of the run in SECOND to those of the run in FIRST.

    Both must be runs of the same suite, by the same rules; that of SECOND may have more estimators
    and scenarios. What they share must have the same code and parameters. If both have a trial, the
    row of FIRST is kept. SECOND does not change.
    """
    from olne_bench.bench.commands.merge import merge as work

    work(**given)
