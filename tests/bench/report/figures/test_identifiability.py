"""The figure of what can be known."""

import pytest

from olne_bench.bench.report.figures import identifiability
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.statistics.noise_identifiability import identifiability_by_noise


def test_a_line_per_weight_that_rises(make_trials, usual) -> None:
    trials = make_trials(estimators=("a",), seeds=1)
    figure = identifiability.draw(identifiability_by_noise(trials, usual))
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


def test_nothing_to_draw_is_said(make_trials, usual) -> None:
    with pytest.raises(NotDrawnError, match="no noise"):
        identifiability.draw(identifiability_by_noise(make_trials(sigmas=(0.0,)), usual))
