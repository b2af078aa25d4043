"""``olne-bench list``: suites and plugins, built in and installed."""

import ast
import tomllib
from pathlib import Path

import click

from olne_bench.plugins import KINDS, PluginError, is_built_in, names, source

#: Read here and not by ``bench.plan.load``, whose imports take a second.
_SUITES = Path(__file__).parents[1] / "plan" / "suites"


@click.command(name="list")
def list_all() -> None:
    """List all suites, estimators, scenarios, sensors and metrics.

    Plugins of installed packages are listed with their module. None of them is imported.
    """
    click.echo("suites")
    for path in sorted(_SUITES.glob("*.toml")):
        suite = tomllib.loads(path.read_text(encoding="utf-8"))
        click.echo(f"  {path.stem:<20} {suite['description']}")
    for kind in KINDS:
        click.echo(f"{kind.name}s")
        for name in names(kind):
            try:
                module, path = source(kind, name)
                note = f"of {module}"
                if is_built_in(kind, name):
                    fields = _fields(path)
                    note = f"parameters: {', '.join(fields)}" if fields else ""
            except PluginError as error:
                note = f"cannot be used: {error}"
            shown = name if name.isprintable() else ascii(name)
            click.echo(f"  {shown:<20} {note}".rstrip())


def _fields(path: Path) -> list[str]:
    """Parameters of a built-in plugin: fields of the first class in its file that has a name."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for found in [node for node in tree.body if isinstance(node, ast.ClassDef)]:
        fields = [node for node in found.body if isinstance(node, ast.AnnAssign)]
        named = {ast.unparse(one.target): ast.unparse(one.annotation) for one in fields}
        if named.pop("name", None) is not None:
            return [name for name, kind in named.items() if not kind.startswith("ClassVar")]
    return []
