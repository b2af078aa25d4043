import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from olne_bench.bench.report.statistics import intervals
from olne_bench.bench.report.statistics.intervals import (
    LEAST_SEEDS_OF_MEANS,
    LEAST_SEEDS_OF_SHARES,
    LEAST_VALUES_OF_MEDIANS,
    mean_by_seed,
    median_interval,
    share_interval,
)

STUDIES = 400
STUDIES_OF_MEANS = 300  # a bootstrap each
LEVELS = np.array([0.01, 0.02, 0.05, 0.1])


@pytest.mark.parametrize("units", [np.arange(40), np.repeat(np.arange(10), 4)])
def test_both_ends_of_a_shares_interval_are_as_unlikely(units) -> None:
    """Wilson's ends p solve (share - p)^2 = z^2 p (1 - p) / n with one n, the effective one."""
    found = share_interval((np.arange(40) % 3 == 0).astype(float), units)
    ends = np.array([found.low, found.high])
    below, above = 1.96**2 * ends * (1 - ends) / (found.estimate - ends) ** 2
    assert below == pytest.approx(above)
    assert len(np.unique(units)) - 1e-3 <= below <= 40.01


@pytest.mark.parametrize("spread", [0.3, 1.0])
@pytest.mark.parametrize("seeds", [LEAST_SEEDS_OF_MEANS, 12, 40])
@pytest.mark.parametrize("shared", [0.0, 1.0, np.inf])
def test_intervals_of_means_of_skewed_errors_cover(spread, seeds, shared) -> None:
    """Log-normal errors at four noise levels; trials of a seed share nothing, much or all."""
    rng = np.random.default_rng([seeds, int(10 * spread)])
    within = rng.standard_normal((STUDIES_OF_MEANS, seeds, len(LEVELS)))
    between = rng.standard_normal((STUDIES_OF_MEANS, seeds, 1))
    drawn = between if shared == np.inf else (within + shared * between) / np.sqrt(1 + shared)
    truth = LEVELS.mean() * np.exp(spread**2 / 2)
    assert 0.9 <= _covered(LEVELS * np.exp(spread * drawn), truth) <= 0.99


@pytest.mark.parametrize("seeds", [LEAST_SEEDS_OF_MEANS, 12, 40])
@pytest.mark.parametrize("folded", [True, False])
def test_intervals_of_means_of_normal_errors_cover(seeds, folded) -> None:
    rng = np.random.default_rng(seeds)
    drawn = rng.standard_normal((STUDIES_OF_MEANS, seeds, 1))
    errors, truth = (np.abs(drawn), np.sqrt(2 / np.pi)) if folded else (1 + 0.25 * drawn, 1.0)
    assert 0.9 <= _covered(np.maximum(errors, 0) * LEVELS, truth * LEVELS.mean()) <= 0.99


def _covered(errors: np.ndarray, truth: float) -> float:
    number = np.repeat(np.arange(errors.shape[1]), errors.shape[2])
    count = np.ones(len(number), int)
    found = [mean_by_seed(study.ravel(), number, count) for study in errors]
    return float(np.mean([interval.low <= truth <= interval.high for interval in found]))


@pytest.mark.parametrize("seeds", [LEAST_SEEDS_OF_SHARES, 6, 8, 12, 20, 40])
@given(share=st.sampled_from([0.1, 0.5, 0.8]), shared=st.booleans())
def test_intervals_of_shares_cover(seeds, share, shared) -> None:
    rng = np.random.default_rng([seeds, int(10 * share)])
    units = np.repeat(np.arange(seeds), 6)
    draws = rng.uniform(size=(STUDIES, seeds, 6))
    if shared:  # half of a seed's trials are correlated
        draws[:, :, 1:4] = draws[:, :, :1]
    found = [share_interval((study < share).ravel().astype(float), units) for study in draws]
    covered = np.mean([interval.low <= share <= interval.high for interval in found])
    assert covered >= 0.9
    assert covered <= 0.99 or seeds < 20


def test_a_share_of_all_or_none_has_an_interval() -> None:
    every = share_interval(np.ones(30), np.arange(30))
    assert (every.estimate, every.high) == (1.0, 1.0)
    assert 0.85 < every.low < 0.95
    none = share_interval(np.zeros(30), np.arange(30))
    assert none.high == pytest.approx(1 - every.low)


def test_equal_sequences_count_once_per_seed() -> None:
    """A row that stands for all seeds is equivalent to one such row per seed."""
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


def test_errors_of_nothing_have_a_mean_of_nothing() -> None:
    none = mean_by_seed(np.zeros(6), np.arange(6), np.ones(6, int))
    assert (none.estimate, none.low, none.high) == (0, 0, 0)


def test_too_little_data_has_no_interval() -> None:
    five = mean_by_seed(np.array([1.0, 9.0, 2, 4, 4]), np.arange(5), np.ones(5, int))
    assert five.estimate == 4.0
    assert np.isnan(five.low) and np.isnan(five.high)
    four = share_interval(np.array([1.0, 0.0] * 4), np.repeat(np.arange(4), 2))
    assert four.estimate == 0.5
    assert np.isnan(four.low) and np.isnan(four.high)
    assert np.isnan(mean_by_seed(np.empty(0), np.empty(0, int), np.empty(0, int)).estimate)
    assert np.isnan(share_interval(np.empty(0), np.empty(0, int)).estimate)


@pytest.mark.parametrize(
    ("sums", "sizes", "error"),
    [
        ([1.0, 3.0], [1, 1], 1.0),
        ([1.0, 3.0], [1, 3], 0.0),  # as much each
        ([2.0, 2.0], [1, 3], 0.5),
        ([1.0, 2.0, 3.0], [1, 1, 1], 1 / np.sqrt(3)),
    ],
)
def test_the_standard_error_is_that_of_a_ratio(sums, sizes, error) -> None:
    found = intervals._standard_error(np.array(sums), np.array(sizes))
    assert found == pytest.approx(error)
    many = intervals._standard_error(np.array([sums, sums]), np.array([sizes, sizes]))
    np.testing.assert_allclose(many, [error, error])


def test_trials_are_added_up_by_seed() -> None:
    values, seeds = np.array([1.0, 2.0, 4.0, 8.0]), np.array([5, 3, 5, 3])
    sums, sizes = intervals._by_seed(values, seeds, np.ones(4, int))
    assert (sums.tolist(), sizes.tolist()) == ([10.0, 5.0], [2, 2])
    sums, sizes = intervals._by_seed(values, seeds, np.array([1, 1, 1, 2]))
    assert (sums.tolist(), sizes.tolist()) == ([10.0, 13.0], [2, 3])
    # Where nothing but such rows is there, they tell how many seeds there are.
    sums, sizes = intervals._by_seed(values[:2], seeds[:2], np.array([3, 3]))
    assert (sums.tolist(), sizes.tolist()) == ([3.0] * 3, [2] * 3)


@pytest.mark.parametrize("factor", [1e-6, 3.0])
def test_an_interval_has_the_unit_of_its_errors(factor) -> None:
    values = np.random.default_rng(0).exponential(size=20)
    seeds, count = np.arange(20), np.ones(20, int)
    one, other = (mean_by_seed(f * values, seeds, count) for f in (1.0, factor))
    for name in ("estimate", "low", "high"):
        assert getattr(other, name) == pytest.approx(factor * getattr(one, name))
    assert 0 < one.low < one.estimate < one.high
    # Errors that are at times large are more uncertain upwards.
    assert one.high - one.estimate > one.estimate - one.low


def test_the_interval_of_many_seeds_is_that_of_a_normal_mean() -> None:
    values = 10 + np.random.default_rng(1).normal(size=2000)
    found = mean_by_seed(values, np.arange(2000), np.ones(2000, int))
    error = values.std(ddof=1) / np.sqrt(2000)
    assert found.estimate == pytest.approx(values.mean())
    assert (found.high - found.estimate) / error == pytest.approx(2.17, abs=0.15)
    assert (found.estimate - found.low) / error == pytest.approx(2.17, abs=0.15)


def test_an_interval_of_errors_does_not_go_below_nothing() -> None:
    values = np.zeros(12)
    values[0] = 1.0
    assert mean_by_seed(values, np.arange(12), np.ones(12, int)).low >= 0
    share = share_interval(values, np.arange(12))
    assert 0 <= share.low < 1 / 12 < share.high <= 1


@pytest.mark.parametrize("hits", [2, 20, 33])
def test_a_share_of_independent_trials_has_wilsons_interval_a_little_wider(hits) -> None:
    values = (np.arange(40) < hits).astype(float)
    found = share_interval(values, np.arange(40))
    usual = binomtest(hits, 40).proportion_ci(method="wilson")
    assert usual.low - 0.02 < found.low <= usual.low + 1e-9
    assert usual.high - 1e-9 <= found.high < usual.high + 0.02


def test_trials_that_go_together_count_as_one() -> None:
    alike = np.repeat(np.arange(20) % 2, 5).astype(float)
    each = share_interval(alike, np.repeat(np.arange(20), 5))
    once = share_interval(alike[::5], np.arange(20))
    mixed = share_interval(np.tile(alike[::5], 5), np.repeat(np.arange(20), 5))
    width, of_once, of_mixed = (one.high - one.low for one in (each, once, mixed))
    assert width == pytest.approx(of_once, rel=0.1)
    assert of_mixed < 0.6 * width


@pytest.mark.parametrize("number", [6, 9, 20, 51])
def test_intervals_of_medians_hold_the_truth(number):
    rng = np.random.default_rng(number)
    held = []
    for _ in range(STUDIES):
        found = median_interval(rng.exponential(size=number))
        assert found.low <= found.estimate <= found.high
        held.append(found.low <= np.log(2) <= found.high)
    assert 0.94 <= np.mean(held) <= 0.99


def test_medians_of_few_and_of_infinite_values():
    few = median_interval(np.arange(LEAST_VALUES_OF_MEDIANS - 1.0))
    assert few.estimate == 2.0 and np.isnan([few.low, few.high]).all()
    mixed = median_interval(np.array([np.inf, 1, 2, 3, 4, np.inf, 5, np.inf]))
    assert (mixed.low, mixed.estimate, mixed.high) == (1, 4.5, np.inf)
    assert median_interval(np.full(8, np.inf)).estimate == np.inf
    assert np.isnan(median_interval(np.empty(0)).estimate)
