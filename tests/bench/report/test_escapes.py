"""Names never break a table, nor become formulas in a spreadsheet."""

import io

import pandas as pd
import pyarrow as pa
import pytest

from olne_bench.bench.report.escapes import csv_safe, csv_safe_arrow, markdown_text
from olne_bench.bench.text import csv_text

RISKY = ("=HYPERLINK(1)", "+1", "-1", "@sum", "\uff1d1")
UNSEEN = {
    "\tx": r"\tx",
    "\r=x": r"\r=x",
    "a\nb": r"a\nb",
    "\x1b[2J\0": r"\x1b[2J\x00",
    "=\u202ea": r"'=\u202ea",
    "\u2028": r"\u2028",
}


@pytest.mark.parametrize("text", RISKY)
def test_formulas_are_text(text):
    assert csv_text(text) == f"'{text}"


@pytest.mark.parametrize(("text", "shown"), UNSEEN.items())
def test_characters_that_are_not_seen_are_escaped(text, shown):
    assert csv_text(text) == shown


@pytest.mark.parametrize("text", ["plain", "", "a=b", "1-2", "[[0.5]]", "'quoted"])
def test_other_texts_stay(text):
    assert csv_text(text) == text


def test_tables_of_both_kinds_agree_and_numbers_stay():
    frame = pd.DataFrame({"name": [*RISKY, *UNSEEN, "plain", ""], "value": [-1.0] * 13})
    expected = [csv_text(text) for text in (*RISKY, *UNSEEN)] + ["plain", ""]
    safe = csv_safe(frame)
    assert safe["name"].tolist() == expected and safe["value"].tolist() == [-1.0] * 13
    table = csv_safe_arrow(pa.table({"name": frame["name"], "value": frame["value"]}))
    assert table.column("name").to_pylist() == expected
    assert table.column("value").to_pylist() == [-1.0] * 13
    written = io.StringIO()
    safe.to_csv(written, index=False)
    assert len(pd.read_csv(io.StringIO(written.getvalue()))) == 13


def test_markdown_stays_on_its_line():
    assert markdown_text("a\nb|c<d>\r*e*") == r"a b\|c\<d\> \*e\*"
