"""Tables of a page: heads and cells as text, whatever kind of study they are of."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import pandas as pd
from markupsafe import Markup, escape

from olne_bench.bench.report.figures import style
from olne_bench.bench.report.page.numbers import chance, human, percent

Row = Mapping[str, Any]
#: What stands in a column: the name of a column, or a text made of a row.
Content = str | Callable[[Row], Any]

_PLACED = ("scenario", "sensor")
_ENDS = "low", "high"  # how names of columns of an interval's ends go on


@dataclass(frozen=True)
class Cell:
    """A cell.

    Attributes:
        text: what it shows.
        key: what it is sorted by; empty for its text.
        numeric: whether it is aligned as a number.
    """

    text: Any
    key: str = ""
    numeric: bool = False


@dataclass(frozen=True)
class Table:
    """A table of a page.

    Attributes:
        name: name of the CSV file that holds all of it; empty if there is none.
        title: its title.
        note: a sentence on how to read it.
        heads: heads of the columns.
        rows: cells of each row, and attributes of the row.
        filtered: whether only rows of the scenario that is shown are shown.
    """

    name: str
    title: str
    note: str
    heads: Sequence[str]
    rows: Sequence[tuple[Mapping[str, str], list[Cell]]] = field(default_factory=list)
    filtered: bool = False

    @property
    def numeric(self) -> list[bool]:
        """Which columns hold numbers."""
        if not self.rows:
            return [False] * len(self.heads)
        return [any(cells[k].numeric for _, cells in self.rows) for k in range(len(self.heads))]


def table_of(
    frame: pd.DataFrame,
    columns: Mapping[str, Content],
    *,
    name: str = "",
    title: str = "",
    note: str = "",
    filtered: bool = False,
    quiet: Callable[[Row], bool] = lambda _: False,
) -> Table:
    """A table with a row for each row of a frame.

    Args:
        frame: the rows.
        columns: what stands below each head; a missing column of the frame has no column.
        name: as in ``Table``.
        title: as in ``Table``.
        note: as in ``Table``.
        filtered: as in ``Table``.
        quiet: which rows are references, not contenders.
    """
    shown = {h: c for h, c in columns.items() if not isinstance(c, str) or c in frame}
    rows = []
    for row in frame.to_dict("records"):
        told = {str(key): value for key, value in row.items()}
        marks = {f"data-{key}": str(told[key]) for key in _PLACED if filtered and key in told}
        marks |= {"class": "floor"} if quiet(told) else {}
        rows.append((marks, [_cell(told, content) for content in shown.values()]))
    return Table(name, title, note, list(shown), rows, filtered)


def _cell(row: Row, content: Content) -> Cell:
    value = row[content] if isinstance(content, str) else content(row)
    if isinstance(value, Cell):
        return value
    if content in ("estimator", "other", "planner"):
        return Cell(named(str(value)))
    if isinstance(value, bool) or not isinstance(value, int | float):
        return Cell(broken(str(value)))
    return number(value)


def number(value: float, text: Any = None) -> Cell:
    """A number, shown for people or as a text, sorted by its value."""
    key = "" if math.isnan(value) else repr(float(value)).replace("inf", "Infinity")
    shown = text if text is not None else str(value) if isinstance(value, int) else human(value)
    return Cell(shown, key, numeric=True)


def share(column: str) -> Callable[[Row], Cell]:
    """A share in percent, with its interval if it has one."""
    return lambda row: number(row[column], _with_ends(row, column, percent, column))


def ends(
    column: str, factor: float = 1.0, *, of: str = "", names: tuple[str, str] = _ENDS
) -> Callable[[Row], Cell]:
    """A number with its interval, if it has one.

    Args:
        column: column of the number.
        factor: multiplies what is shown.
        of: beginning of the names of both ends. Default: the column.
        names: how these names go on.
    """
    return lambda row: number(
        factor * row[column],
        _with_ends(row, column, lambda v: human(factor * v), of or column, names),
    )


def p_value(column: str) -> Callable[[Row], Cell]:
    """A p-value."""
    return lambda row: number(row[column], chance(row[column]))


def _with_ends(
    row: Row,
    column: str,
    shown: Callable[[float], str],
    of: str,
    names: tuple[str, str] = _ENDS,
) -> Markup:
    low, high = (row.get(f"{of}_{name}", math.nan) for name in names)
    text = escape(shown(row[column]))
    if math.isnan(low) or math.isnan(high) or low == high:
        return text
    return text + Markup(" <small>[{}, {}]</small>").format(shown(low), shown(high))


def named(name: str, tag: str = "") -> Markup:
    """An estimator's name beside its colours."""
    strong, light = style.estimator_colours(name)
    swatch = Markup('<i class="swatch" style="--a:{};--b:{}"></i>').format(strong, light)
    mark = Markup(' <span class="tag">{}</span>').format(tag) if tag else Markup("")
    return swatch + broken(name) + mark


def broken(name: str) -> Markup:
    """A name that may break after its underscores."""
    return Markup("_<wbr>").join(escape(part) for part in name.split("_"))
