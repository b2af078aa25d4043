"""``olne-bench check``: does a plugin keep the rules of its kind?"""

import sys

import click

from olne_bench.bench.commands.conformance import identify, run_checks
from olne_bench.bench.commands.options import BUDGET, memory_option, name_and_value
from olne_bench.plugins import KINDS, absolute


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
def check(
    plugin: str, kind: str | None, parameters: tuple[str, ...], budget: float, memory: float
) -> None:
    """Check PLUGIN, FILE.py:CLASS or a name from 'olne-bench list'.

    PLUGIN is an estimator, scenario, sensor or metric. Each check prints one line. The exit code
    is 1 if a check fails. 'weak' is not a failure: the plugin keeps the rules, but a good one does
    better.
    """
    chosen = dict(name_and_value("--parameter", text) for text in parameters)
    found = identify(plugin, chosen, kind)  # bad input ends here
    failed = 0
    limit = int(memory * 2**30)
    checks = run_checks(found, absolute(plugin), chosen, budget=budget, memory=limit)
    for name, outcome in checks:
        failed += outcome.status != "ok"
        verdict = "FAIL" if outcome.status != "ok" else "weak" if outcome.message else "pass"
        click.echo(f"{verdict}  {name}{': ' if outcome.message else ''}{outcome.message}")
        if outcome.status == "timeout":
            click.echo("the plugin hangs: the remaining checks are skipped")
    if failed:
        click.echo(f"{plugin}: {failed} check{'s' if failed > 1 else ''} failed")
        sys.exit(1)
    click.echo(f"{plugin} conforms")
