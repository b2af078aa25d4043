"""Checks of numbers: what passes, and the messages on what does not."""

import numpy as np
import pytest

from olne_bench.checks import check_count, check_number, check_whole


def test_numbers_within_bounds_pass() -> None:
    for value in (1, 10**6, np.int64(3)):
        check_count("count", value)
        check_whole("count", value)
    for value in (1e-6, 1e3, 1, np.float64(0.5)):
        check_number("spread", value)


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0, "0"),
        (10**6 + 1, "1000001"),
        (2.0, "2.0"),
        (True, "True"),
        ("3", "'3'"),
        (None, "None"),
        (float("nan"), "nan"),
        (10**5000, "a number of 16610 bits"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_what_is_no_count_is_named(value: object, shown: str) -> None:
    with pytest.raises(
        ValueError, match=f"^count must be an integer of 1 to 1000000, got {shown}$"
    ):
        check_count("count", value)


@pytest.mark.parametrize(
    "value", [0.0, 1001, True, "1", float("inf"), float("nan"), 10**5000], ids=type
)
def test_what_is_no_number_within_bounds_is_named(value: object) -> None:
    with pytest.raises(ValueError, match="spread must be a number of 1e-06 to 1000, got"):
        check_number("spread", value)


def test_bounds_of_others_are_left_to_them() -> None:
    check_whole("num_players", -3)
    with pytest.raises(ValueError, match="num_players must be a whole number"):
        check_whole("num_players", 2.5)
