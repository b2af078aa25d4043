"""Errors in pairs: who wins a trial, and whether that is more than chance."""

from itertools import product

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest, false_discovery_control

from olne_bench.bench.report.statistics.pairs import compare_pairs, holm, permutation_p


def pairs(a: list[float], b: list[float]) -> pd.DataFrame:
    return pd.DataFrame({"a": a, "b": b, "seed": range(len(a))})


def test_failures_lose_and_ties_count_half() -> None:
    found = compare_pairs(pairs([1.0, np.inf, np.inf, 1.0], [2.0, 5.0, np.inf, 1.0]), False)
    assert (found["pairs"], found["wins"], found["p"]) == (4, 0.5, 1.0)


@pytest.mark.parametrize(("excess", "wins"), [(1e-9, 0.5), (9e-4, 0.5), (1.2e-3, 0.0)])
def test_errors_within_a_thousandth_are_a_tie(excess: float, wins: float) -> None:
    best = np.random.default_rng(0).uniform(size=30)
    found = compare_pairs(pairs(best * (1 + excess), best), False)
    assert found["wins"] == wins
    assert (found["p"] < 1e-3) == (wins == 0)


@given(scale=st.floats(1e-6, 1e6))
def test_only_the_order_of_errors_counts(scale: float) -> None:
    a, b = np.random.default_rng(0).uniform(size=(2, 30))
    plain = compare_pairs(pairs(a, b), False)
    assert plain == compare_pairs(pairs(scale * a, scale * b), False)
    turned = compare_pairs(pairs(b, a), False)
    assert turned["wins"] == pytest.approx(1 - plain["wins"])
    assert turned["p"] == plain["p"]


def test_a_family_is_compared_draw_by_draw() -> None:
    """Six levels of five draws are five independent units, not thirty."""
    table = pairs([0.0] * 30, [1.0] * 30).assign(seed=[*range(5)] * 6)
    fixed, family = (compare_pairs(table, family) for family in (False, True))
    assert fixed["p"] < 0.001
    assert family["p"] == pytest.approx(2 / 2**5)
    assert family["wins_low"] < fixed["wins_low"]


@given(st.lists(st.integers(-7, 7), min_size=1, max_size=9))
def test_permutations_of_units_agree_with_all_of_them(advantages: list[int]) -> None:
    sums = [np.dot(signs, advantages) for signs in product((1, -1), repeat=len(advantages))]
    exact = np.mean(np.abs(sums) >= abs(sum(advantages)))
    assert permutation_p(np.array(advantages)) == pytest.approx(exact, rel=1e-9)


def test_there_is_no_floor_that_many_comparisons_cannot_pass() -> None:
    assert permutation_p(np.ones(100, int)) == pytest.approx(2.0**-99)
    assert permutation_p(np.array([2] * 50 + [3] * 50)) == pytest.approx(2.0**-99)
    large = np.random.default_rng(0).integers(1, 500, size=2000)
    assert 0 < permutation_p(large) < 1e-12


@given(wins=st.integers(0, 60))
def test_without_clusters_it_is_the_sign_test(wins: int) -> None:
    advantages = np.repeat([1, -1], [wins, 60 - wins])
    exact = binomtest(wins, 60).pvalue
    assert permutation_p(advantages) == pytest.approx(exact, rel=1e-9)


def test_no_difference_is_rarely_significant() -> None:
    rng = np.random.default_rng(1)
    p = [permutation_p(rng.choice([-1, 1], size=50)) for _ in range(400)]
    assert np.mean(np.array(p) < 0.05) < 0.08


@given(st.lists(st.floats(0, 1), min_size=1, max_size=12))
def test_holm(p: list[float]) -> None:
    adjusted = holm(np.array(p))
    order = np.argsort(p)
    assert (np.diff(adjusted[order]) >= 0).all()
    assert adjusted[order[0]] == pytest.approx(min(1, len(p) * min(p)))
    # Never more lenient than Benjamini and Hochberg, never stricter than Bonferroni.
    assert (adjusted >= false_discovery_control(p) - 1e-12).all()
    assert (adjusted <= np.minimum(1, len(p) * np.array(p)) + 1e-12).all()
