"""``olne-bench estimate``: run an estimator on a recording, whose true weights may be unknown."""

from typing import Any

import click

from olne_bench.bench.commands.options import BUDGET, PATH, FiniteRange


@click.command()
@click.argument("recording", type=PATH)
@click.option(
    "--scenario",
    help="Scenario whose cost features the players have. Default: that of the recording.",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    help="Draw of the scenario family that the tracks show; players that start there get its "
    "targets.",
)
@click.option(
    "--estimator", default="kkt_constrained", show_default=True, help="Name, or FILE.py[:CLASS]."
)
@click.option(
    "--episode", type=click.IntRange(min=0), default=0, show_default=True, help="Episode to use."
)
@click.option(
    "--noise",
    type=FiniteRange(min=0, min_open=True),
    help="Standard deviation of position noise [m]. Default: from the roughness of the tracks.",
)
@click.option(
    "--budget",
    type=BUDGET,
    default=60.0,
    show_default=True,
    help="Time limit of the estimate [s].",
)
@click.option("--out", type=PATH, help="New CSV file for the weights.")
def estimate(**given: Any) -> None:
    """Estimate the weights of every player in RECORDING.

    Motion model, cost features and noise scales are those of the scenario. Target speeds, lanes
    and goals are taken from the recording's road file, from a draw with the same start, from the
    scenario or from the data; each is printed with its source. Tracks that leave the road or run
    against its lanes are refused.
    """
    from olne_bench.bench.commands.estimate import estimate as work

    work(**given)
