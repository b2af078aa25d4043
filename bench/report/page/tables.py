"""Tables of a page: heads, cells and numbers as text, whatever kind of study they are of."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup, escape

from olne_bench.bench.report.figures import style

Row = Mapping[str, Any]
#: What stands in a column: the name of a column, or a text made of a row.
Content = str | Callable[[Row], Any]
#: What stands below each head.
Columns = dict[str, Content]

_PLACED = ("scenario", "sensor")
_ENDS = "low", "high"  # how names of columns of an interval's ends go on
#: Errors below this are rounding of solvers.
_ROUNDING = 1e-9
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class Cell:
    """A cell."""

    text: Any
    key: str = ""  # what it is sorted by; empty for its text
    numeric: bool = False


@dataclass(frozen=True)
class Table:
    """A table of a page."""

    name: str  # of the CSV file that holds all of it; empty if there is none
    title: str
    note: str  # on how to read it
    heads: Sequence[str]
    #: Attributes of each row, and its cells.
    rows: Sequence[tuple[Mapping[str, str], list[Cell]]] = field(default_factory=list)
    filtered: bool = False  # whether only rows of the scenario that is shown are shown

    @property
    def numeric(self) -> list[bool]:
        """Which columns hold numbers."""
        return [any(cells[k].numeric for _, cells in self.rows) for k in range(len(self.heads))]


def own(*names: str) -> Columns:
    """Columns of a frame below their own names."""
    return {name.replace("_", " ").capitalize(): name for name in names}


def table_of(
    frame: pd.DataFrame,
    columns: Columns,
    *,
    name: str = "",
    title: str = "",
    note: str = "",
    filtered: bool = False,
    quiet: Callable[[Row], bool] = lambda _: False,
) -> Table:
    """A table of a frame's rows, without columns that it lacks; ``quiet`` rows do not contend."""
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
    """A number times a factor, with its interval, if the columns ``{of}_{name}`` have one."""

    def cell(row: Row) -> Cell:
        text = _with_ends(row, column, lambda v: human(factor * v), of or column, names)
        return number(factor * row[column], text)

    return cell


def p_value(column: str) -> Callable[[Row], Cell]:
    """A p-value."""
    return lambda row: number(row[column], chance(row[column]))


def _with_ends(
    row: Row, column: str, shown: Callable[[float], str], of: str, names: tuple[str, str] = _ENDS
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


def rounded(values: np.ndarray, digits: int = 4) -> list[float | None]:
    """Numbers rounded to significant digits; None for those that are not finite."""
    return [float(f"{v:.{digits - 1}e}") if math.isfinite(v) else None for v in values.tolist()]


def decimals(values: np.ndarray, places: int) -> list[Any]:
    """Nested lists of an array rounded to decimal places."""
    return list(np.round(values, places).tolist())


def human(value: float | None) -> str:
    """A number for people: two or three digits, or a dash if there is none."""
    if value is None or math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞"
    if abs(value) < _ROUNDING:
        return "0" if value == 0 else "≈ 0"
    if 1e-4 <= abs(value) < 1e5:
        return f"{value:.0f}" if abs(value) >= 99.5 else f"{value:.2g}"
    mantissa, exponent = f"{value:.1e}".split("e")
    return f"{mantissa}·10{str(int(exponent)).translate(_SUPERSCRIPTS)}"


def percent(share: float) -> str:
    """A share in percent, or a dash if there is none."""
    return "–" if math.isnan(share) else f"{100 * share:.3g} %"


def chance(p: float) -> str:
    """A p-value for people."""
    if math.isnan(p):
        return "–"
    return "< 0.001" if p < 0.001 else f"{p:.2g}"
