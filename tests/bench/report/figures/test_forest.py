"""The board's picture."""

import pandas as pd
import pytest

from olne_bench.bench.report.figures import forest
from olne_bench.bench.report.formats import NotDrawnError
from olne_bench.bench.report.statistics.score import log_errors, score_table
from tests.bench.report.statistics.test_score import FACTORS, STUDY, trials


def test_a_row_for_each_estimator_the_best_first_and_hollow_floors_last() -> None:
    figure = forest.draw(score_table(log_errors(trials(FACTORS), STUDY), STUDY), STUDY)
    position = figure.axes[0]
    assert [axes.get_title() for axes in figure.axes] == ["position error", "cosine error"]
    names = [label.get_text() for label in position.get_yticklabels()]
    assert names[0] == "map *" and names[-1] == "uniform"  # the star: it knows the prior
    dots = [line for line in position.lines if line.get_marker() == "o"]
    assert [round(dot.get_xdata()[0], 6) for dot in dots] == [0.8, 1.0, 1.0, 9.0]
    assert dots[-1].get_markerfacecolor() == "white" != dots[0].get_markerfacecolor()
    assert "2 scenarios" in figure.get_suptitle()
    assert "relative to kkt_constrained" in figure.get_suptitle()


def test_a_guess_that_fixed_weights_may_make_right_is_not_drawn() -> None:
    told = trials(FACTORS)
    fixed = told[told["scenario"] == "two_player"]
    figure = forest.draw(score_table(log_errors(fixed, STUDY), STUDY), STUDY)
    names = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert "uniform" not in names and len(names) == 3
    alone = score_table(log_errors(fixed[fixed["estimator"] == "uniform"], STUDY), STUDY)
    with pytest.raises(NotDrawnError):
        forest.draw(alone, STUDY)


def test_without_scores_there_is_no_picture() -> None:
    empty = score_table(log_errors(trials(FACTORS).assign(sigma=0.0), STUDY), STUDY)
    with pytest.raises(NotDrawnError, match="no estimator has a score"):
        forest.draw(pd.DataFrame(empty), STUDY)
