"""How often estimators fail, over the noise level."""

import numpy as np
import pytest

from olne_bench.bench.report.figures import failures, style


def test_shares_of_failures_with_intervals(make_trials):
    trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.0, 0.1), seeds=10)
    trials.loc[trials.index[1:5], "status"] = "timeout"  # 4 of the 10 with noise
    shares = failures.failure_shares(trials).set_index("sigma").drop(columns="estimator")
    assert shares.loc[0.0].tolist() == [0, 0, 0]  # 40 equal sequences: nothing random
    # Wilson's formula: (p + z^2/2n +- z sqrt(p(1-p)/n + z^2/4n^2)) / (1 + z^2/n)
    p, n, z = 0.4, 10, 1.959964
    middle, spread = p + z**2 / (2 * n), z * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    interval = [(middle - spread) / (1 + z**2 / n), (middle + spread) / (1 + z**2 / n)]
    assert shares.loc[0.1].tolist() == pytest.approx([p, *interval], abs=1e-6)


def test_failures_are_those_of_the_published_study(make_trials):
    trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.1,), seeds=4)
    trials.loc[trials.index[0], "published_forward"] = 0
    trials.loc[trials.index[1], "status"] = "failed_forward"
    assert failures.failure_shares(trials)["share"].tolist() == [0.5]
    figure = failures.draw(trials)
    (text,) = (text.get_text() for text in figure.legends[0].get_texts())
    assert text == "a: 2 of 4, 1 without a prediction"


def draw(trials):
    with style.applied():
        (axes,) = failures.draw(trials).axes
    return axes


def test_levels_are_apart_evenly_and_series_beside_each_other(make_trials):
    sigmas = (0.0, 0.01, 0.5)
    axes = draw(make_trials(estimators=("a", "b", "c"), sensors=("full",), sigmas=sigmas))
    assert list(axes.get_xticks()) == [0, 1, 2]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["0", "0.01", "0.5"]
    places = np.array([line.get_xdata() for line in axes.lines])
    assert places.shape == (3, 3)
    shifts = places - np.arange(3)
    np.testing.assert_allclose(shifts, np.tile(shifts[:, :1], 3))
    assert len(set(shifts[:, 0])) == 3
    assert np.abs(shifts).max() < 0.5
    np.testing.assert_allclose(shifts.sum(), 0, atol=1e-12)
    alone = draw(make_trials(estimators=("a",), sensors=("full",), sigmas=sigmas))
    np.testing.assert_array_equal(alone.lines[0].get_xdata(), [0, 1, 2])


def test_who_was_not_run_at_a_level_has_no_point_there(make_trials):
    trials = make_trials(estimators=("a", "b"), sensors=("full",), sigmas=(0.1, 0.2))
    axes = draw(trials[(trials["estimator"] == "a") | (trials["sigma"] == 0.2)])
    assert sorted(len(line.get_xdata()) for line in axes.lines) == [1, 2]
    (one,) = (line.get_xdata() for line in axes.lines if len(line.get_xdata()) == 1)
    assert round(float(one[0])) == 1


@pytest.mark.parametrize(("failed", "top"), [(0, None), (30, 1.02)])
def test_intervals_are_whole_within_the_panel(make_trials, failed, top):
    trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.1,), seeds=30)
    trials.loc[trials.index[:failed], "status"] = "timeout"
    axes = draw(trials)
    low, high = axes.get_ylim()
    (interval,) = axes.collections[0].get_segments()
    assert low < 0 <= interval[0, 1] < interval[1, 1] <= high
    assert high <= 1.1 * max(interval[1, 1], 0.05)
    assert top is None or high == top
