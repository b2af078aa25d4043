"""Salts: where they come from, and which are allowed."""

import hashlib

import pytest

from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.suite import FRESH, check_salt, salt_id, salted
from olne_bench.errors import UserError

SUITE = load_suite("quick")


def test_rows_show_eight_digits_of_a_hash() -> None:
    assert salt_id("sea") == hashlib.sha256(b"sea").hexdigest()[:8]


def test_a_new_run_has_the_salt_of_its_suite_or_the_one_asked_for() -> None:
    assert salted(SUITE, None, None) == SUITE
    assert salted(SUITE, "sea", None).salt == "sea"
    assert SUITE.salt != "sea"


def test_fresh_salts_are_long_and_differ() -> None:
    one, other = (salted(SUITE, FRESH, None).salt for _ in range(2))
    assert one != other
    assert len(one) == len(other) == 32


def test_a_run_goes_on_with_its_own_salt() -> None:
    former = salted(SUITE, FRESH, None)
    for wanted in (None, FRESH, former.salt):
        assert salted(SUITE, wanted, former).salt == former.salt
    assert salted(SUITE, SUITE.salt, SUITE).salt == SUITE.salt


def test_a_run_has_no_two_salts() -> None:
    with pytest.raises(UserError, match="--salt 'sea' is not that of the run to continue"):
        salted(SUITE, "sea", salted(SUITE, FRESH, None))
    with pytest.raises(UserError, match=salt_id(SUITE.salt)):
        salted(SUITE, FRESH, SUITE)  # none was drawn then


def test_a_salt_is_a_text_of_one_line() -> None:
    for good in (None, "a", "a b", "a" * 120):
        check_salt(good)
    for wrong in ("", " ", "a\nb", "a" * 121):
        with pytest.raises(UserError, match=r"a text of 1 to 120 characters"):
            check_salt(wrong)
