"""The figure of errors over the noise."""

import numpy as np
import pytest

from olne_bench.bench.report.figures import errors, panels, style
from olne_bench.bench.report.not_drawn import NotDrawnError


def draw(trials, study):
    with style.applied():
        return errors.draw(trials, study)


def test_medians_with_intervals_by_sensor_the_primary_metric_first(make_trials, usual) -> None:
    trials = make_trials(estimators=("a", "uniform"), seeds=9)
    figure = draw(trials, usual)
    assert [axes.get_title() for axes in figure.axes] == ["full", "partial"] * 3
    assert figure.axes[0].get_ylabel() == "Position error [m]"
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
    (line,) = draw(trials, usual).axes[0].lines
    assert np.isfinite(line.get_ydata()).tolist() == [True, False]


def test_there_are_six_panels_at_most_and_five_decades(make_trials, usual) -> None:
    trials = make_trials(estimators=("a",), sensors=tuple("abcdefgh"), seeds=1)
    trials.loc[trials.index[1], "position_error"] = 1e-12
    figure = draw(trials, usual)
    assert len(figure.axes) == panels.MOST_PANELS
    for axes in figure.axes:
        low, high = axes.get_ylim()
        assert high / low <= 1.001e5


def test_nothing_to_draw_is_said(make_trials, usual) -> None:
    with pytest.raises(NotDrawnError, match="nothing was attempted"):
        draw(make_trials(status="skipped"), usual)
