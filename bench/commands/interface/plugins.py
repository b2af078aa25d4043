"""How the commands on plugins are called."""

import click

from olne_bench.bench.commands.options import BUDGET, command, memory_option, several, shown
from olne_bench.plugins import KINDS

_KIND = click.Choice([kind.name for kind in KINDS])


@command()
@click.argument("plugin", metavar="PLUGIN")
@click.option(
    "--kind", type=_KIND, help="Kind of the plugin, if plugins of several kinds have this name."
)
@several(
    "--parameter",
    "parameters",
    metavar="NAME=VALUE",
    help="Parameter of the plugin, such as p=0.3 (repeatable).",
)
@shown(
    "--budget", type=BUDGET, default=20.0, help="Time limit of each estimate [s], for estimators."
)
@memory_option("Memory limit of the plugin's process.")
def check() -> None:
    """Check PLUGIN, FILE.py:CLASS or a name from 'olne-bench list'.

    PLUGIN is an estimator, scenario, sensor or metric. Each check prints one line. The exit code
    is 1 if a check fails. 'weak' is not a failure: the plugin keeps the rules, but a good one does
    better.
    """


@command("list")
def list_all() -> None:
    """List all suites, estimators, scenarios, sensors and metrics, a line each.

    Parameters are in parentheses. Plugins of installed packages are listed with their module. None
    of them is imported.
    """


@command()
@click.argument("kind", type=_KIND)
@click.argument("name")
def new() -> None:
    """Create a folder NAME with a working plugin of this KIND, its pyproject.toml and a test."""
