"""``olne-bench draws``: solve the draws of a suite once, for all machines that run it."""

from typing import Any

import click

from olne_bench.bench.commands.options import JOBS, PATH


@click.command()
@click.argument("suite")
@click.option("--out", type=PATH, help="File. Default: where 'olne-bench run' looks for it.")
@click.option("--jobs", type=JOBS, default=2, show_default=True, help="Number of processes.")
@click.option("--scenario", multiple=True, help="Only this scenario (repeatable).")
@click.option("--seeds", type=click.IntRange(1, 10**8), help="Only the first draws, this many.")
def draws(**given: Any) -> None:
    """Solve all draws of SUITE and write them to a file, which 'olne-bench run' then uses.

    The file holds truths, equilibria and held-out starts. If it exists, the command goes on with it
    and adds what it lacks. Draws of plugins are not solved.
    """
    from olne_bench.bench.commands.draws import draws as work

    work(**given)
