"""The figure of draws won."""

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.report.figures import draw_wins, style, wins
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.statistics.wins import ALL, win_table

NAMES = ["error", "scenario", "estimator", "other", "won", "even", "lost"]


def table(*rows: tuple[object, ...]) -> pd.DataFrame:
    return win_table(pd.DataFrame(rows, columns=NAMES))


WON = [("map", "ridge", 20, 0, 1), ("map", "uniform", 21, 0, 0), ("ridge", "uniform", 3, 10, 8)]
THREE = table(
    *(
        (error, scenario, *row)
        for error in ("position_error", "cosine_error")
        for scenario in ("merge", "highway")
        for row in WON
    )
)


def test_the_better_one_of_a_pair_is_named_first() -> None:
    with style.applied():
        figure = wins.draw(THREE)
    names = [text.get_text() for text in figure.axes[0].get_yticklabels()]
    assert names == ["map over uniform", "map over ridge", "uniform over ridge"]
    assert [axes.get_title() for axes in figure.axes] == ["position error", "cosine error"]
    assert "2 scenarios" in figure.get_suptitle()


def test_points_and_intervals_are_those_of_all_scenarios() -> None:
    with style.applied():
        axes = wins.draw(THREE).axes[0]
    lines = {line.get_ydata()[0]: line for line in axes.lines if line.get_marker() == "o"}
    whole = THREE[(THREE["scenario"] == ALL) & (THREE["error"] == "position_error")]
    shares = whole.set_index(["estimator", "other"])["wins"]
    assert lines[1].get_xdata()[0] == pytest.approx(100 * shares["map", "ridge"])
    assert lines[2].get_xdata()[0] == pytest.approx(100 * (1 - shares["ridge", "uniform"]))
    faces = {row: line.get_markerfacecolor() for row, line in lines.items()}
    assert (faces[0] == "white", faces[2] == "white") == (False, True)
    (low,), (high,) = whole.loc[whole["other"] == "ridge", ["wins_low", "wins_high"]].to_numpy().T
    ends = [line.get_xdata() for line in axes.lines if len(line.get_ydata()) == 2]
    assert any(np.allclose(end, [100 * low, 100 * high]) for end in ends)


def test_a_single_scenario_has_no_marks_beside_its_interval(tmp_path) -> None:
    one = table(("position_error", "merge", "a", "b", 5, 0, 1))
    with style.applied():
        figure = wins.draw(one)
    assert "merge" in figure.get_suptitle()
    assert len(figure.legends[0].get_texts()) == 2
    assert [path.name for path in draw_wins(one, tmp_path, ("png",)).files] == ["wins.png"]


def test_nothing_is_drawn_of_one_estimator(tmp_path) -> None:
    with pytest.raises(NotDrawnError, match="two estimators"):
        wins.draw(table())
    assert not draw_wins(table(), tmp_path / "none", ("png",)).files
