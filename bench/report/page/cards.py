"""Cards that describe estimators, made from the docstrings of their sources, which are not run.

A card shows the first paragraph, and what follows ``Paper:``, ``Assumes:``, ``Cost:`` and
``Trust:`` at the start of a line, each of which may continue in indented lines.
"""

import ast
import inspect
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from olne_bench.bench.plan.entries import EstimatorEntry
from olne_bench.errors import UserError
from olne_bench.plugins import ESTIMATOR, is_file, source

#: Fields of a card, in the order in which they are shown.
FIELDS = ("Paper", "Assumes", "Cost", "Trust")
_FIELD = re.compile(rf"^({'|'.join(FIELDS)}):\s*(.*(?:\n +.*)*)", re.MULTILINE)
_MOST_CHARACTERS = 20_000  # of a docstring


@dataclass(frozen=True)
class Card:
    """An estimator of a run, as it describes itself."""

    label: str
    parameters: Mapping[str, Any]
    origin: str  # a module, or the name of a file
    method: str = ""  # the first paragraph of its docstring
    fields: Mapping[str, str] = field(default_factory=dict)  # some of ``FIELDS``
    missing: str = ""  # why there is no text, if there is none


def card_of(entry: EstimatorEntry) -> Card:
    """The card of a suite's estimator."""
    own = is_file(entry.name)
    origin = Path(entry.name.rpartition(".py")[0] + ".py").name if own else entry.name
    plain = Card(entry.label, entry.parameters, origin)
    try:
        module, path = source(ESTIMATOR, entry.name)
        said = docstring(path, entry.name.rpartition(".py:")[2] if own else entry.name)
    except (UserError, OSError, ValueError, SyntaxError, RecursionError, MemoryError) as error:
        what = f"its file {origin}" if own else f"the estimator {entry.name}"
        reason = error.strerror if isinstance(error, OSError) else "not found, or no Python"
        return replace(plain, missing=f"{what} is not here: {reason}")
    text = inspect.cleandoc(said[:_MOST_CHARACTERS])
    found = {name: _plain(value) for name, value in _FIELD.findall(text)}
    method = _plain(_FIELD.sub("", text).strip().split("\n\n")[0])
    missing = "" if method else "it has no docstring"
    origin = origin if own else module
    return replace(plain, origin=origin, method=method, fields=found, missing=missing)


def docstring(path: Path, name: str) -> str:
    """The docstring of a module, or else of an estimator's class in it; empty if there is none.

    OSError, ValueError, SyntaxError, or (if it is nested too deep) RecursionError or MemoryError
    if the file cannot be read as Python.
    """
    tree = ast.parse(path.read_text(encoding="utf-8"))
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef)]
    named = [node for node in classes if node.name == name]
    able = [node for node in classes if ESTIMATOR.method in map(_name, node.body)]
    nodes: list[ast.Module | ast.ClassDef] = [tree, *named, *able]
    return next(filter(None, map(ast.get_docstring, nodes)), "")


def _name(node: ast.stmt) -> str:
    return node.name if isinstance(node, ast.FunctionDef) else ""


def _plain(text: str) -> str:
    """Text on one line, without backticks."""
    return " ".join(text.replace("`", "").split())
