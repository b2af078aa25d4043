"""Escape names and messages of foreign origin for tables of all kinds."""

import re
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from olne_bench.bench.text import FORMULA, csv_text, one_line
from olne_bench.files import whole_file
from olne_bench.visible import visible

_FORMULA_PATTERN = f"^[{re.escape(''.join(FORMULA))}]"
#: What ``visible`` escapes.
_UNSEEN_PATTERN = r"[\p{Cc}\p{Cf}\p{Zl}\p{Zp}]"
#: Characters that have a meaning in Markdown, or in HTML within it.
_MARKDOWN = "\\`*_[]<>|#&~"


def markdown_text(text: str) -> str:
    """A name as text in a cell of a Markdown table."""
    return "".join(f"\\{c}" if c in _MARKDOWN else c for c in one_line(text))


def csv_safe(table: pd.DataFrame) -> pd.DataFrame:
    """A table whose text cells no spreadsheet reads as formulas."""
    texts = [str(name) for name in table if not pd.api.types.is_numeric_dtype(table[name])]
    safe = {n: [csv_text(v) if isinstance(v, str) else v for v in table[n]] for n in texts}
    return table.assign(**safe)


def write_csv(
    table: pd.DataFrame, path: Path, digits: str | None = None, *, new: bool = False
) -> None:
    """Write a table as CSV, completely or not at all; one that has to be ``new`` replaces no file.

    ``digits`` is a format of numbers, such as ``%.4g``; by default they have all digits.
    """
    with whole_file(path, new=new) as unfinished:
        csv_safe(table).to_csv(unfinished, index=False, float_format=digits)


def csv_safe_arrow(table: pa.Table) -> pa.Table:
    """An Arrow table whose text cells no spreadsheet reads as formulas."""
    for place, field in enumerate(table.schema):
        if pa.types.is_string(field.type) or pa.types.is_large_string(field.type):
            column = table.column(place)
            if pc.any(pc.match_substring_regex(column, _UNSEEN_PATTERN)).as_py():
                shown = [None if text is None else visible(text) for text in column.to_pylist()]
                column = pa.chunked_array([shown], field.type)
            quote, nothing = pa.scalar("'", field.type), pa.scalar("", field.type)
            escaped = pc.binary_join_element_wise(quote, column, nothing)
            risky = pc.match_substring_regex(column, _FORMULA_PATTERN)
            table = table.set_column(place, field, pc.if_else(risky, escaped, column))
    return table
