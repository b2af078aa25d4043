"""Names never break a table, nor become formulas in a spreadsheet."""

import io

import pandas as pd
import pyarrow as pa
import pytest

from olne_bench.bench.report.escapes import csv_safe, csv_safe_arrow, csv_text, markdown_text

RISKY = ("=HYPERLINK(1)", "+1", "-1", "@sum", "\tx", "\rx")


@pytest.mark.parametrize("text", RISKY)
def test_formulas_are_text(text):
    assert csv_text(text) == f"'{text}".replace("\r", " ")


@pytest.mark.parametrize("text", ["plain", "", "a=b", "1-2", "[[0.5]]", "'quoted"])
def test_other_texts_stay(text):
    assert csv_text(text) == text


def test_tables_of_both_kinds_agree_and_numbers_stay():
    frame = pd.DataFrame({"name": [*RISKY, "plain", ""], "value": [-1.0] * 8})
    expected = [csv_text(text) for text in RISKY] + ["plain", ""]
    safe = csv_safe(frame)
    assert safe["name"].tolist() == expected and safe["value"].tolist() == [-1.0] * 8
    table = csv_safe_arrow(pa.table({"name": frame["name"], "value": frame["value"]}))
    assert table.column("name").to_pylist() == expected
    assert table.column("value").to_pylist() == [-1.0] * 8
    written = io.StringIO()
    safe.to_csv(written, index=False)
    assert len(pd.read_csv(io.StringIO(written.getvalue()))) == 8


def test_markdown_stays_on_its_line():
    assert markdown_text("a\nb|c<d>\r*e*") == r"a b\|c\<d\> \*e\*"
