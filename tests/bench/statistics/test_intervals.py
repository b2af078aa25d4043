import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.statistics.intervals import mean_by_seed, share_interval

STUDIES = 400


@pytest.mark.parametrize("spread", [0.3, 0.7])
@given(seeds=st.sampled_from([5, 10, 40]), shared=st.sampled_from([0.0, 1.0]))
def test_intervals_of_means_cover(spread: float, seeds: int, shared: float) -> None:
    """Skewed errors at four noise levels, seeds with something in common or not."""
    rng = np.random.default_rng([seeds, int(shared)])
    levels = np.array([0.01, 0.02, 0.05, 0.1])
    number = np.repeat(np.arange(seeds), len(levels))
    within = rng.standard_normal((STUDIES, seeds, len(levels)))
    between = shared * rng.standard_normal((STUDIES, seeds, 1))
    errors = levels * np.exp(spread * (within + between) / np.sqrt(1 + shared))
    truth = levels.mean() * np.exp(spread**2 / 2)
    count = np.ones(len(number), int)
    found = [mean_by_seed(study.ravel(), number, count) for study in errors]
    covered = np.mean([interval.low <= truth <= interval.high for interval in found])
    assert 0.9 <= covered <= 0.99


@given(share=st.sampled_from([0.1, 0.5, 0.8]), shared=st.booleans())
def test_intervals_of_shares_cover(share: float, shared: bool) -> None:
    rng = np.random.default_rng(int(10 * share))
    units = np.repeat(np.arange(40), 6)
    draws = rng.uniform(size=(STUDIES, 40, 6))
    if shared:  # half of a seed's trials go the same way
        draws[:, :, 1:4] = draws[:, :, :1]
    found = [share_interval((study < share).ravel().astype(float), units) for study in draws]
    covered = np.mean([interval.low <= share <= interval.high for interval in found])
    assert 0.9 <= covered <= 0.99


def test_a_share_of_all_or_none_has_an_interval() -> None:
    every = share_interval(np.ones(30), np.arange(30))
    assert (every.estimate, every.high) == (1.0, 1.0)
    assert 0.85 < every.low < 0.95
    none = share_interval(np.zeros(30), np.arange(30))
    assert none.high == pytest.approx(1 - every.low)


def test_equal_sequences_count_once_per_seed() -> None:
    """A row that stands for all seeds is the same as that row in each of them."""
    seeds = np.arange(10)
    values = np.random.default_rng(0).uniform(size=10)
    once = mean_by_seed(
        np.append(values, 7.0), np.append(seeds, 0), np.append(np.ones(10, int), 10)
    )
    each = mean_by_seed(np.append(values, np.full(10, 7.0)), np.tile(seeds, 2), np.ones(20, int))
    assert once == each
    assert once.estimate == pytest.approx((values.sum() + 70) / 20)


def test_a_failure_makes_the_mean_infinite_and_nothing_undefined() -> None:
    values = np.array([1.0, 2.0, np.inf, 1.5])
    interval = mean_by_seed(values, np.arange(4), np.ones(4, int))
    assert interval.estimate == np.inf
    assert np.isnan(interval.low) and np.isnan(interval.high)


def test_errors_without_spread_have_a_point_for_an_interval() -> None:
    interval = mean_by_seed(np.full(6, 0.25), np.arange(6), np.ones(6, int))
    assert (interval.low, interval.high) == pytest.approx((0.25, 0.25))


def test_too_little_data_has_no_interval() -> None:
    one = mean_by_seed(np.array([2.0]), np.array([0]), np.array([1]))
    assert one.estimate == 2.0
    assert np.isnan(one.low) and np.isnan(one.high)
    assert np.isnan(mean_by_seed(np.empty(0), np.empty(0, int), np.empty(0, int)).estimate)
    assert np.isnan(share_interval(np.empty(0), np.empty(0, int)).estimate)
