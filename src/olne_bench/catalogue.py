"""What plugins there are, in a line each. None of them is imported: their sources are read."""

import ast
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from olne_bench.plugins import (
    ESTIMATOR,
    SCENARIO,
    SENSOR,
    Kind,
    PluginError,
    find_class,
    is_built_in,
    names,
    parameter_names,
    source,
)

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class CatalogueEntry:
    """A plugin.

    Attributes:
        name: its name.
        description: first line of its docstring, of the module's for an installed one; or why it
            cannot be used.
        parameters: names of its parameters; empty for an installed one.
    """

    name: str
    description: str
    parameters: tuple[str, ...] = ()


def catalogue(kind: Kind) -> list[CatalogueEntry]:
    """All plugins of a kind, built in and installed."""
    return [_entry(kind, name) for name in names(kind)]


def _entry(kind: Kind, name: str) -> CatalogueEntry:
    shown = name if name.isprintable() else ascii(name)
    try:
        module, path = source(kind, name)
        if not is_built_in(kind, name):
            return CatalogueEntry(shown, f"of {module}")
        return CatalogueEntry(shown, *_class_in(path))
    except PluginError as error:
        return CatalogueEntry(shown, f"cannot be used: {error}")


def _class_in(path: Path) -> tuple[str, tuple[str, ...]]:
    """Description and fields of a built-in plugin: of the first class that has a name."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for found in [node for node in tree.body if isinstance(node, ast.ClassDef)]:
        fields = [node for node in found.body if isinstance(node, ast.AnnAssign)]
        named = {ast.unparse(one.target): ast.unparse(one.annotation) for one in fields}
        if named.pop("name", None) is not None:
            own = [name for name, kind in named.items() if not kind.startswith("ClassVar")]
            return _first_line(found), tuple(own)
    return _first_line(tree), ()


def _first_line(node: ast.Module | ast.ClassDef) -> str:
    return (ast.get_docstring(node) or "").partition("\n")[0].replace("``", "")


def scenarios() -> "pd.DataFrame":
    """Scenarios by name: a line on each, and the options of ``olne_bench.scenario``."""
    return _table(SCENARIO)


def sensors() -> "pd.DataFrame":
    """Sensors by name: a line on each, and its parameters."""
    return _table(SENSOR)


def estimators() -> "pd.DataFrame":
    """Estimators by name: a line on each, and its parameters."""
    return _table(ESTIMATOR)


def _table(kind: Kind) -> "pd.DataFrame":
    import pandas as pd  # it takes long, and 'olne-bench list' does without

    rows = []
    for one in catalogue(kind):
        ours = is_built_in(kind, one.name)  # those that a class inherits are parameters, too
        known = parameter_names(find_class(kind, one.name)) if ours else one.parameters
        rows.append((one.name, one.description, ", ".join(known)))
    return pd.DataFrame(rows, columns=["name", "description", "parameters"]).set_index("name")
