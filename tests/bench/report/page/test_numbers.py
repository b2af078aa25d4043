"""Numbers for the page."""

import math

import numpy as np
import pytest

from olne_bench.bench.report.page.tables import decimals, human, rounded


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
