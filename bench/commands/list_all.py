"""``olne-bench list``: suites and plugins, built in and installed."""

import tomllib
from pathlib import Path

import click

from olne_bench.catalogue import catalogue
from olne_bench.plugins import KINDS

#: Read here and not by ``bench.plan.load``, whose imports take a second.
_SUITES = Path(__file__).parents[1] / "plan" / "suites"


def list_all() -> None:
    """List all suites, estimators, scenarios, sensors and metrics, a line each."""
    click.echo("suites")
    for path in sorted(_SUITES.glob("*.toml")):
        suite = tomllib.loads(path.read_text(encoding="utf-8"))
        click.echo(f"  {path.stem:<20} {suite['description']}")
    for kind in KINDS:
        click.echo(f"{kind.name}s")
        for one in catalogue(kind):
            known = f" (parameters: {', '.join(one.parameters)})" if one.parameters else ""
            click.echo(f"  {one.name:<20} {one.description}{known}".rstrip())
