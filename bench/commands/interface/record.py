"""``olne-bench record``: play a scenario's draws and write what happened."""

from typing import Any

import click

from olne_bench.bench.commands.options import PATH


@click.command()
@click.argument("scenario")
@click.option(
    "--seeds",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Number of draws to play, from seed 0 on; a fixed scenario has only one.",
)
@click.option("--out", type=PATH, required=True, help="New Parquet file.")
@click.option("--video", type=PATH, help="New GIF or MP4 file of the first draw.")
@click.option(
    "--option",
    "options",
    multiple=True,
    metavar="NAME=VALUE",
    help="An option of the scenario, such as num_players=3 (repeatable).",
)
def record(**given: Any) -> None:
    """Play SCENARIO at its equilibrium and write the recording.

    A draw without a certified equilibrium, locally or globally so far, is named in the summary and
    not written.
    """
    from olne_bench.bench.commands.record import record as work

    work(**given)
