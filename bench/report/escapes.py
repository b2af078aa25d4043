"""Escape names and messages of foreign origin for tables of all kinds."""

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from olne_bench.bench.text import one_line

#: Spreadsheets read a cell that starts with one of these as a formula.
_FORMULA = ("=", "+", "-", "@", "\t", "\r")
_FORMULA_PATTERN = r"^[=+\-@\t\r]"
#: Characters that have a meaning in Markdown, or in HTML within it.
_MARKDOWN = "\\`*_[]<>|#&~"


def markdown_text(text: str) -> str:
    """A name as text in a cell of a Markdown table."""
    return "".join(f"\\{c}" if c in _MARKDOWN else c for c in one_line(text))


def csv_text(text: str) -> str:
    """A text cell that no spreadsheet reads as a formula, and no reader as two rows."""
    safe = f"'{text}" if text.startswith(_FORMULA) else text
    return safe.replace("\r", " ")


def csv_safe(table: pd.DataFrame) -> pd.DataFrame:
    """A table whose text cells no spreadsheet reads as formulas."""
    texts = [name for name in table if not pd.api.types.is_numeric_dtype(table[name])]
    return table.assign(
        **{
            str(name): [csv_text(v) if isinstance(v, str) else v for v in table[name]]
            for name in texts
        }
    )


def csv_safe_arrow(table: pa.Table) -> pa.Table:
    """An Arrow table whose text cells no spreadsheet reads as formulas."""
    for place, field in enumerate(table.schema):
        if pa.types.is_string(field.type) or pa.types.is_large_string(field.type):
            column = table.column(place)
            quote, nothing = pa.scalar("'", field.type), pa.scalar("", field.type)
            escaped = pc.binary_join_element_wise(quote, column, nothing)
            risky = pc.match_substring_regex(column, _FORMULA_PATTERN)
            safe = pc.replace_substring(pc.if_else(risky, escaped, column), "\r", " ")
            table = table.set_column(place, field, safe)
    return table
