import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from olne_bench.bench.report.figures.rolling import rolling_statistics

INF = np.inf


def statistics(x, y, count=None, window=5):
    count = np.ones(len(x), dtype=int) if count is None else np.array(count)
    return rolling_statistics(np.array(x, float), np.array(y, float), count, window)


def test_hand_computed_with_failures():
    # Ordered by x the ordinates are 1, 2, inf, 3, inf, inf, 4.
    s = statistics(x=[3, 1, 2, 4, 6, 5, 7], y=[INF, 1, 2, 3, INF, INF, 4])
    assert s.x.tolist() == [3, 4, 5]
    # Windows sorted: 1 2 3 inf inf | 2 3 inf inf inf | 3 4 inf inf inf
    assert s.lower.tolist() == [2, 3, 4]
    assert s.median.tolist() == [3, INF, INF]
    assert s.upper.tolist() == [INF, INF, INF]


def test_between_two_points_the_worse_one_counts():
    s = statistics(x=[0, 1, 2, 3], y=[1, 2, 3, INF], window=4)
    assert (s.lower.item(), s.median.item(), s.upper.item()) == (2, 3, INF)


def test_a_row_counts_as_often_as_it_occurred():
    s = statistics(x=[0, 1], y=[7, 1], count=[3, 2])
    assert s.x.tolist() == [0.4]
    assert s.median.tolist() == [7]


def test_fewer_points_than_the_window_give_nothing():
    assert statistics(x=[0, 1], y=[1, 2]).median.size == 0


@given(
    st.lists(st.floats(0, 1), min_size=9, max_size=30),
    st.data(),
)
def test_a_failure_never_improves_a_statistic(y, data):
    failed = data.draw(st.integers(0, len(y) - 1))
    worse = [*y[:failed], INF, *y[failed + 1 :]]
    before, after = (statistics(range(len(y)), values) for values in (y, worse))
    for name in ("lower", "median", "upper"):
        assert (getattr(after, name) >= getattr(before, name)).all()
        assert not np.isnan(getattr(after, name)).any()


def test_some_of_the_windows_are_those_of_all():
    rng = np.random.default_rng(0)
    x, y, count = rng.uniform(size=200), rng.uniform(size=200), np.ones(200, int)
    every, some = (rolling_statistics(x, y, count, 10, most) for most in (None, 7))
    chosen = np.linspace(0, 190, 7).round().astype(int)
    for name in ("x", "lower", "median", "upper"):
        np.testing.assert_array_equal(getattr(some, name), getattr(every, name)[chosen])
