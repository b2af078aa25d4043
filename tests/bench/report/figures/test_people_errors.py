"""The figure of errors shows what the table of a study of people says."""

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.report.figures.people_errors import errors_over_time


def test_each_road_has_a_line_for_each_method_with_its_interval():
    rows = [
        {"road": road, "half": half, "kind": kind, "ahead": ahead, "method": method, "cars": cars}
        | {"over_straight": value, "over_straight_low": value - 0.1, "over_straight_high": 1.0}
        for road, cars in (("A", 40), ("$B", 30), ("C", 10))
        for half in ("first", "second", "both")
        for kind in ("all", "wave")
        for ahead in (1.0, 3.0)
        for method, value in (("straight", 1.0), ("game", 0.6 + 0.01 * len(half)), ("idm", 0.8))
    ]
    figure = errors_over_time(pd.DataFrame(rows))
    assert [axes.get_title() for axes in figure.axes] == [
        "A: 40 cars",
        "$B: 30 cars",
    ]
    game, idm = figure.axes[0].containers
    assert (game.get_label(), idm.get_label()) == ("game", "idm")
    assert game.lines[0].get_ydata() == pytest.approx(0.64)  # of both halves
    (bars,) = game.lines[2]
    ends = np.array(bars.get_segments())[:, :, 1]
    assert ends == pytest.approx(np.array([[0.54, 1.0], [0.54, 1.0]]))
