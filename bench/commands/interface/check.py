"""``olne-bench check``: does a plugin keep the rules of its kind?"""

from typing import Any

import click

from olne_bench.bench.commands.options import BUDGET, memory_option
from olne_bench.plugins import KINDS


@click.command()
@click.argument("plugin", metavar="PLUGIN")
@click.option(
    "--kind",
    type=click.Choice([kind.name for kind in KINDS]),
    help="Kind of the plugin, if plugins of several kinds have this name.",
)
@click.option(
    "--parameter",
    "parameters",
    multiple=True,
    metavar="NAME=VALUE",
    help="Parameter of the plugin, such as p=0.3 (repeatable).",
)
@click.option(
    "--budget",
    type=BUDGET,
    default=20.0,
    show_default=True,
    help="Time limit of each estimate [s], for estimators.",
)
@memory_option("Memory limit of the plugin's process.")
def check(**given: Any) -> None:
    """Check PLUGIN, FILE.py:CLASS or a name from 'olne-bench list'.

    PLUGIN is an estimator, scenario, sensor or metric. Each check prints one line. The exit code
    is 1 if a check fails. 'weak' is not a failure: the plugin keeps the rules, but a good one does
    better.
    """
    from olne_bench.bench.commands.check import check as work

    work(**given)
