"""``olne-bench gate``: does a run keep the limits of its suite?"""

from typing import Any

import click

from olne_bench.bench.commands.options import PATH


@click.command()
@click.argument("folder", type=PATH)
@click.option(
    "--suite", help="Use the limits of this suite, a name or a TOML file, instead of the run's own."
)
def gate(**given: Any) -> None:
    """Check the run in FOLDER against the limits in the [gate] table of its suite.

    Exit code 0 if all limits hold, 1 if one fails or the run is not finished, 2 on bad input.
    """
    from olne_bench.bench.commands.gate import gate as work

    work(**given)
