"""``olne-bench report``: write the tables, page and figures of a run again."""

from typing import Any

import click

from olne_bench.bench.commands.options import PATH, PLUGIN
from olne_bench.bench.report.formats import FORMATS, USUAL_FORMATS


@click.command()
@click.argument("folder", type=PATH)
@click.option("--figures/--no-figures", default=True, show_default=True, help="Draw figures.")
@click.option(
    "--formats",
    default=",".join(USUAL_FORMATS),
    show_default=True,
    help=f"Formats of the figures: {', '.join(FORMATS)}.",
)
@click.option(
    "--play",
    "playable",
    multiple=True,
    metavar="SIGMA:SEED",
    help="Noise level and seed of further trials that the page can play (repeatable).",
)
@click.option(
    "--plugin",
    "loaded",
    type=PLUGIN,
    multiple=True,
    metavar="FILE.py[:CLASS]",
    help="A scenario or sensor of the run that may be loaded, to play it again (repeatable).",
)
def report(**given: Any) -> None:
    """Write the tables, page and figures of the run in FOLDER again.

    A scenario or sensor that is a plugin is played again only if --plugin names it: a run folder
    may come from others.
    """
    from olne_bench.bench.commands.report import report as work

    work(**given)
