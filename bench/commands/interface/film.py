"""``olne-bench film``: one drive of a suite as a video."""

from typing import Any

import click

from olne_bench.bench.commands.options import PATH, memory_option


@click.command()
@click.argument("road")
@click.option("--out", type=PATH, required=True, help="The film: MP4 or GIF.")
@click.option(
    "--suite",
    default="driving",
    show_default=True,
    help="Suite of drives that says traffic, noise and rules, such as driving_stock.",
)
@click.option("--planner", default="oracle", show_default=True, help="Who drives the ego.")
@click.option("--seed", type=click.IntRange(0, 10**6), default=0, show_default=True)
@memory_option("Memory limit of the estimator's process.")
def film(**given: Any) -> None:
    """Write one drive on ROAD as a video, with the ego's plan and what it expects of others."""
    from olne_bench.bench.commands.film import film as work

    work(**given)
