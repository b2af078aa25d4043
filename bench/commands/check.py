"""``olne-bench check``: does a plugin keep the rules of its kind?"""

import sys

import click

from olne_bench.bench.commands.options import name_and_value
from olne_bench.bench.conformance.conforms import identify, run_checks
from olne_bench.plugins import absolute


def check(
    plugin: str, kind: str | None, parameters: tuple[str, ...], budget: float, memory: float
) -> None:
    """Check PLUGIN, FILE.py:CLASS or a name from 'olne-bench list'."""
    chosen = dict(name_and_value("--parameter", text) for text in parameters)
    found = identify(plugin, chosen, kind)  # bad input ends here
    failed = 0
    said: dict[str, str] = {}  # messages, and the check that said each first
    limit = int(memory * 2**30)
    checks = run_checks(found, absolute(plugin), chosen, budget=budget, memory=limit)
    for name, outcome in checks:
        failed += outcome.status != "ok"
        verdict = "FAIL" if outcome.status != "ok" else "weak" if outcome.message else "pass"
        first = said.setdefault(outcome.message, name)
        message = outcome.message if first == name else f"the same as in {first!r}"
        click.echo(f"{verdict}  {name}{f': {message}' if outcome.message else ''}")
        if outcome.status == "timeout":
            click.echo("the plugin hangs: the remaining checks are skipped")
    if failed:
        click.echo(f"{plugin}: {failed} check{'s' if failed > 1 else ''} failed")
        sys.exit(1)
    click.echo(f"{plugin} conforms")
