"""The figure of what can be known."""

import pytest

from olne_bench.bench.report.figures import identifiability
from olne_bench.bench.report.not_drawn import NotDrawnError


def test_a_line_per_weight_that_rises(make_trials, usual) -> None:
    figure = identifiability.draw(make_trials(estimators=("a",), seeds=1), usual)
    assert [axes.get_title() for axes in figure.axes] == ["full", "partial"]
    ends = []
    for axes in figure.axes:
        assert len(axes.lines) == 2 * 4
        for line in axes.lines:
            levels, left = line.get_data()
            assert list(levels) == [0.01, 0.1]
            assert 0 <= left[0] < left[1] <= 1
        ends.append(sum(line.get_ydata()[-1] for line in axes.lines))
    assert ends[0] < ends[1]  # who sees less knows less
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [
        "proximity",
        "speed",
        "acceleration",
        "yaw_rate",
    ]


def test_nothing_to_draw_is_said(make_trials, usual) -> None:
    with pytest.raises(NotDrawnError, match="no noise"):
        identifiability.draw(make_trials(sigmas=(0.0,)), usual)
