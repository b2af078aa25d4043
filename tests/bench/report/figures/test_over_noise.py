"""Figures of errors, failures, and of what stays unknown, over the noise."""

import numpy as np
import pytest

from olne_bench.bench.report.figures import over_noise, style
from olne_bench.bench.report.figures.over_noise import draw_identifiability
from olne_bench.bench.report.formats import NotDrawnError
from olne_bench.bench.report.statistics.identifiability import identifiability_by_noise


def errors(trials, study):
    with style.applied():
        return over_noise.draw_errors(trials, study)


def test_medians_with_intervals_by_sensor_the_primary_metric_first(make_trials, usual) -> None:
    trials = make_trials(estimators=("a", "uniform"), seeds=9)
    figure = errors(trials, usual)
    # A row of a sensor, a column of a metric.
    assert [axes.get_title() for axes in figure.axes] == ["full"] * 3 + ["partial"] * 3
    metrics = [axes.get_ylabel() for axes in figure.axes]
    assert metrics[0] == "Position error [m]"
    assert metrics[:3] == metrics[3:] and len(set(metrics)) == 3
    own = trials[(trials["estimator"] == "a") & (trials["sensor"] == "full")]
    medians = own.groupby("sigma")["position_error"].median()
    line = next(line for line in figure.axes[0].lines if line.get_marker() != "None")
    np.testing.assert_allclose(line.get_ydata()[1:], medians[[0.01, 0.1]])
    bars = figure.axes[0].collections[0].get_segments()
    assert all(bar[0, 1] <= y <= bar[1, 1] for bar, y in zip(bars, line.get_ydata(), strict=True))
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == ["a", "uniform"]


def test_failures_of_half_of_the_trials_leave_no_point(make_trials, usual) -> None:
    trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.1, 0.2), seeds=8)
    trials.loc[(trials["sigma"] == 0.2) & (trials["seed"] < 5), "status"] = "crash"
    (line,) = errors(trials, usual).axes[0].lines
    assert np.isfinite(line.get_ydata()).tolist() == [True, False]


def test_there_are_six_panels_at_most_and_five_decades(make_trials, usual) -> None:
    trials = make_trials(estimators=("a",), sensors=tuple("abcdefgh"), seeds=1)
    trials.loc[trials.index[1], "position_error"] = 1e-12
    figure = errors(trials, usual)
    assert len(figure.axes) == style.MOST_PANELS
    for axes in figure.axes:
        low, high = axes.get_ylim()
        assert high / low <= 1.001e5


def test_nothing_to_draw_of_errors_is_said(make_trials, usual) -> None:
    with pytest.raises(NotDrawnError, match="nothing was attempted"):
        errors(make_trials(status="skipped"), usual)


def test_shares_of_failures_with_intervals(make_trials):
    trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.0, 0.1), seeds=10)
    trials.loc[trials.index[1:5], "status"] = "timeout"  # 4 of the 10 with noise
    shares = over_noise.failure_shares(trials).set_index("sigma").drop(columns="estimator")
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
    assert over_noise.failure_shares(trials)["share"].tolist() == [0.5]
    figure = over_noise.draw_failures(trials)
    (text,) = (text.get_text() for text in figure.legends[0].get_texts())
    assert text == "a: 2 of 4, 1 without a prediction"


def failures(trials):
    with style.applied():
        (axes,) = over_noise.draw_failures(trials).axes
    return axes


def test_levels_are_apart_evenly_and_series_beside_each_other(make_trials):
    sigmas = (0.0, 0.01, 0.5)
    axes = failures(make_trials(estimators=("a", "b", "c"), sensors=("full",), sigmas=sigmas))
    assert list(axes.get_xticks()) == [0, 1, 2]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["0", "0.01", "0.5"]
    places = np.array([line.get_xdata() for line in axes.lines])
    assert places.shape == (3, 3)
    shifts = places - np.arange(3)
    np.testing.assert_allclose(shifts, np.tile(shifts[:, :1], 3))
    assert len(set(shifts[:, 0])) == 3
    assert np.abs(shifts).max() < 0.5
    np.testing.assert_allclose(shifts.sum(), 0, atol=1e-12)
    alone = failures(make_trials(estimators=("a",), sensors=("full",), sigmas=sigmas))
    np.testing.assert_array_equal(alone.lines[0].get_xdata(), [0, 1, 2])


def test_who_was_not_run_at_a_level_has_no_point_there(make_trials):
    trials = make_trials(estimators=("a", "b"), sensors=("full",), sigmas=(0.1, 0.2))
    axes = failures(trials[(trials["estimator"] == "a") | (trials["sigma"] == 0.2)])
    assert sorted(len(line.get_xdata()) for line in axes.lines) == [1, 2]
    (one,) = (line.get_xdata() for line in axes.lines if len(line.get_xdata()) == 1)
    assert round(float(one[0])) == 1


@pytest.mark.parametrize(("failed", "top"), [(0, None), (30, 1.02)])
def test_intervals_are_whole_within_the_panel(make_trials, failed, top):
    trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.1,), seeds=30)
    trials.loc[trials.index[:failed], "status"] = "timeout"
    axes = failures(trials)
    low, high = axes.get_ylim()
    (interval,) = axes.collections[0].get_segments()
    assert low < 0 <= interval[0, 1] < interval[1, 1] <= high
    assert high <= 1.1 * max(interval[1, 1], 0.05)
    assert top is None or high == top


def test_a_line_per_weight_that_rises(make_trials, usual) -> None:
    trials = make_trials(estimators=("a",), seeds=1)
    figure = draw_identifiability(identifiability_by_noise(trials, usual))
    assert [axes.get_title() for axes in figure.axes] == ["full", "partial"]
    ends = []
    for axes in figure.axes:
        assert len(axes.lines) == 2 * 4
        assert [label.get_text() for label in axes.get_xticklabels()] == ["0.01", "0.1"]
        for line in axes.lines:
            assert 0 <= line.get_ydata()[0] < line.get_ydata()[1] <= 1
        ends.append(sum(line.get_ydata()[-1] for line in axes.lines))
    assert ends[0] < ends[1]  # who sees less knows less
    (legend,) = figure.legends
    names = ["proximity", "speed", "acceleration", "yaw_rate"]
    assert [text.get_text() for text in legend.get_texts()] == names


def test_nothing_to_draw_of_weights_is_said(make_trials, usual) -> None:
    with pytest.raises(NotDrawnError, match="no noise"):
        draw_identifiability(identifiability_by_noise(make_trials(sigmas=(0.0,)), usual))
