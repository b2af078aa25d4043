"""``olne-bench export``: a recording's motion as CSV or CommonRoad, with a road file beside it."""

from typing import Any

import click

from olne_bench.bench.commands.options import PATH


@click.command()
@click.argument("recording", type=PATH)
@click.option(
    "--episode", type=click.IntRange(min=0), default=0, show_default=True, help="Episode to write."
)
@click.option("--out", type=PATH, required=True, help="New CSV or CommonRoad XML file.")
def export(**given: Any) -> None:
    """Write the motion in RECORDING as a table or a CommonRoad scenario.

    Lanes and the players' targets go to a TOML file of the same name beside it. Weights are not
    written: 'olne-bench import' and 'olne-bench estimate' recover them.
    """
    from olne_bench.bench.commands.export import export as work

    work(**given)
