"""Cards that describe estimators, made from the docstrings of their sources.

The source is read, not run. Besides paragraphs, its docstring may have equations (indented blocks)
and the lines

    Paper: where the method was published.
    Assumes: what has to hold.
    Cost: what it takes.
    Trust: when to trust it, and when not.

each of which may continue in indented lines.
"""

import ast
import inspect
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from olne_bench.bench.plan.entries import EstimatorEntry
from olne_bench.bench.report.study import Study
from olne_bench.errors import UserError
from olne_bench.plugins import ESTIMATOR, is_file, source

#: Fields of a card, in the order in which they are shown.
FIELDS = ("Paper", "Assumes", "Cost", "Trust")
_FIELD = re.compile(rf"({'|'.join(FIELDS)}):\s*(.*)")
_ITEM = re.compile(r"- |\d+\. ")
_MOST_CHARACTERS = 20_000  # of a docstring


@dataclass(frozen=True)
class Text:
    """The parts of a docstring.

    Attributes:
        method: the first paragraph.
        equations: indented blocks.
        fields: texts by name, some of ``FIELDS``.
        more: other paragraphs.
    """

    method: str = ""
    equations: tuple[str, ...] = ()
    fields: Mapping[str, str] = field(default_factory=dict)
    more: tuple[str, ...] = ()


@dataclass(frozen=True)
class Card:
    """An estimator of a run, as it describes itself.

    Attributes:
        label: its name in tables.
        text: its docstring.
        parameters: parameters that the suite gives it.
        origin: where its code is: a module of this package or another one, or the name of a file.
        missing: why there is no text; empty if there is one.
    """

    label: str
    text: Text
    parameters: Mapping[str, Any]
    origin: str
    missing: str = ""


@dataclass(frozen=True)
class MeasuredCost:
    """The cost of an estimator in a run.

    Attributes:
        least: least median time [s] in a scenario and sensor; infinite if half of the attempts
            were stopped.
        most: largest median time [s].
        failures: number of attempts that failed.
        trials: number of attempts.
    """

    least: float
    most: float
    failures: int
    trials: int


def cards(study: Study, labels: Iterable[str]) -> list[Card]:
    """Cards of the estimators with these labels that the study knows."""
    return [card_of(study.estimators[label]) for label in labels if label in study.estimators]


def measured_cost(table: pd.DataFrame, label: str) -> MeasuredCost:
    """The cost of the estimator with a label, from a leaderboard."""
    rows = table[table["estimator"] == label]
    times = rows["solve_seconds_median"]
    return MeasuredCost(
        float(times.min()),
        float(times.max()),
        int(rows["failures"].sum()),
        int(rows["trials"].sum()),
    )


def card_of(entry: EstimatorEntry) -> Card:
    """The card of a suite's estimator."""
    own = is_file(entry.name)
    origin = Path(entry.name.rpartition(".py")[0] + ".py").name if own else entry.name
    try:
        module, path = source(ESTIMATOR, entry.name)
        origin = origin if own else module
        text = read_text(docstring(path, entry.name.rpartition(".py:")[2] if own else entry.name))
    except (UserError, OSError, ValueError, SyntaxError) as error:
        what = f"its file {origin}" if own else f"the estimator {entry.name}"
        reason = error.strerror if isinstance(error, OSError) else "not found, or no Python"
        return Card(entry.label, Text(), entry.parameters, origin, f"{what} is not here: {reason}")
    missing = "" if text.method else "it has no docstring"
    return Card(entry.label, text, entry.parameters, origin, missing)


def docstring(path: Path, name: str) -> str:
    """The docstring of a module, or else of an estimator's class in it; empty if there is none.

    Args:
        path: path of the module.
        name: name of the class, or the class's own ``name``.

    Raises:
        OSError, ValueError, SyntaxError: if the file cannot be read as Python.
    """
    tree = ast.parse(path.read_text(encoding="utf-8"))
    said = ast.get_docstring(tree)
    if said:
        return said
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef)]
    named = [node for node in classes if node.name == name]
    able = [node for node in classes if _estimates(node)]
    found = (ast.get_docstring(node) for node in (*named, *able))
    return next((text for text in found if text), "")


def _estimates(node: ast.ClassDef) -> bool:
    return any(isinstance(n, ast.FunctionDef) and n.name == ESTIMATOR.method for n in node.body)


def read_text(doc: str) -> Text:
    """Split a docstring into its parts."""
    paragraphs: list[str] = []
    equations: list[str] = []
    fields: dict[str, str] = {}
    for block in re.split(r"\n\s*\n", inspect.cleandoc(doc[:_MOST_CHARACTERS])):
        lines = [line for line in block.splitlines() if line.strip()]
        if lines and all(line.startswith("    ") for line in lines):
            equations.append(inspect.cleandoc("\n" + block))
            continue
        paragraphs += _paragraphs(_take_fields(lines, fields))
    first, *more = paragraphs or [""]
    return Text(first, tuple(equations), fields, tuple(more))


def _take_fields(lines: list[str], fields: dict[str, str]) -> list[str]:
    """Move the fields of a block's lines into a mapping; return the other lines."""
    rest, current = [], ""
    for line in lines:
        found = _FIELD.match(line)
        if found:
            current = found[1]
            fields[current] = _marked(found[2])
        elif current and line.startswith(" "):
            fields[current] = _marked(f"{fields[current]} {line.strip()}")
        else:
            current = ""
            rest.append(line)
    return rest


def _paragraphs(lines: Iterable[str]) -> list[str]:
    """Lines joined to paragraphs, one for each item of a list."""
    found: list[str] = []
    for line in lines:
        if found and not _ITEM.match(line):
            found[-1] += f" {line.strip()}"
        else:
            found.append(line.strip())
    return [_marked(text) for text in found]


def _marked(text: str) -> str:
    """Text without backticks."""
    return text.replace("`", "").strip()
