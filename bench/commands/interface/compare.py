"""``olne-bench compare``: what got better or worse from one run to another."""

from typing import Any

import click

from olne_bench.bench.commands.options import PATH


@click.command()
@click.argument("before", type=PATH)
@click.argument("after", type=PATH)
@click.option(
    "--estimator",
    "estimators",
    multiple=True,
    metavar="NAME[=OTHER]",
    help="Compare only this estimator, which is called OTHER in AFTER (repeatable).",
)
@click.option("--out", type=PATH, help="New CSV file for the table.")
@click.option("--page", type=PATH, help="New .html file for a page that shows both runs.")
def compare(**given: Any) -> None:
    """Compare two runs trial by trial, on the same noise.

    It compares the errors that rank estimators, and which trials fail. BEFORE and AFTER may be the
    same folder, to compare two estimators of one run.

    Exit code 0 if nothing got significantly worse (permutation test, 5 %, Holm's correction), 1 if
    something did, 2 on bad input.
    """
    from olne_bench.bench.commands.compare import compare as work

    work(**given)
