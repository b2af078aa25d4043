"""Tables of a page, and its numbers."""

import math

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.report.page import tables as t
from olne_bench.bench.report.page.tables import decimals, human, rounded


def test_cells_are_texts_numbers_names_and_intervals() -> None:
    frame = pd.DataFrame(
        {"scenario": ["a_b<"], "estimator": ["map"], "n": [3], "x": [0.12345], "p": [1e-9]}
        | {"s": [0.5], "s_low": [0.4], "s_high": [math.nan]}
    )
    columns = {"Where": "scenario", "Who": "estimator", "N": "n", "X": "x", "Gone": "gone"}
    columns |= {"S": t.share("s"), "P": t.p_value("p")}
    table = t.table_of(frame, columns, filtered=True, quiet=lambda row: row["n"] == 3)
    assert table.heads == ["Where", "Who", "N", "X", "S", "P"]
    assert table.numeric == [False, False, True, True, True, True]
    ((marks, cells),) = table.rows
    assert marks == {"data-scenario": "a_b<", "class": "floor"}
    texts = [str(cell.text) for cell in cells]
    assert texts[0] == "a_<wbr>b&lt;" and texts[1].endswith("</i>map")
    assert texts[2:] == ["3", "0.12", "50 %", "< 0.001"]
    assert cells[3].key == "0.12345"


def test_keys_of_numbers_can_be_sorted_by_a_script() -> None:
    assert [t.number(v).key for v in (1.0, math.inf, math.nan)] == ["1.0", "Infinity", ""]


def test_intervals_stand_beside_their_number() -> None:
    row = {"r": 0.5, "r_low": 0.25, "r_high": 0.75}
    assert str(t.ends("r", 100)(row).text) == "50 <small>[25, 75]</small>"


def test_a_table_without_rows_has_heads() -> None:
    table = t.table_of(pd.DataFrame(columns=["x"]), {"X": "x"})
    assert (table.heads, table.numeric) == (["X"], [False])


def test_numbers_are_rounded_to_significant_digits() -> None:
    values = np.array([123456.0, 0.000123456, -1.0, 0.0, np.inf, np.nan])
    assert rounded(values) == [123500.0, 0.0001235, -1.0, 0.0, None, None]
    assert rounded(values[:2], digits=2) == [120000.0, 0.00012]
    assert decimals(np.array([[1.23456], [2.0]]), 3) == [[1.235], [2.0]]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (math.nan, "–"),
        (math.inf, "∞"),
        (0.0, "0"),
        (1e-10, "≈ 0"),
        (-9.9e-10, "≈ 0"),
        (1e-9, "1.0·10⁻⁹"),
        (9.9e-5, "9.9·10⁻⁵"),
        (1e-4, "0.0001"),
        (0.01234, "0.012"),
        (99.4, "99"),
        (99.5, "100"),
        (123.4, "123"),
        (99_999.0, "99999"),
        (1e5, "1.0·10⁵"),
        (-250_000.0, "-2.5·10⁵"),
    ],
)
def test_people_read_two_or_three_digits(value: float | None, text: str) -> None:
    assert human(value) == text
