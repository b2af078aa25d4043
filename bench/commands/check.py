"""``olne-bench check``: does an estimator keep to what every estimator has to?"""

import sys

import click

from olne_bench.bench.commands.conformance import run_checks
from olne_bench.bench.commands.options import BUDGET, MEMORY
from olne_bench.bench.run.loading import probe
from olne_bench.estimators.registry import absolute_reference, load_estimator


@click.command()
@click.argument("estimator", metavar="ESTIMATOR")
@click.option(
    "--budget",
    type=BUDGET,
    default=20.0,
    show_default=True,
    help="Seconds that it has for each estimate.",
)
@click.option(
    "--memory",
    type=MEMORY,
    default=4.0,
    show_default=True,
    metavar="GIB",
    help="Memory that it may use.",
)
def check(estimator: str, budget: float, memory: float) -> None:
    """Check ESTIMATOR, FILE.py:CLASS or a name from 'olne-bench list'.

    A line for each check; exit code 1 if one of them fails.
    """
    probe([(estimator, {})])  # bad input ends here
    load_estimator(estimator)
    failed = 0
    limit = int(memory * 2**30)
    for name, outcome in run_checks(absolute_reference(estimator), budget=budget, memory=limit):
        met = outcome.status == "ok"
        failed += not met
        reason = "" if met else f": {outcome.message}"
        click.echo(f"{'pass' if met else 'FAIL'}  {name}{reason}")
        if outcome.status == "timeout":
            click.echo("it hangs, so no further check is made")
    if failed:
        click.echo(f"{estimator}: {failed} check{'s' if failed > 1 else ''} failed")
        sys.exit(1)
    click.echo(f"{estimator} conforms")
