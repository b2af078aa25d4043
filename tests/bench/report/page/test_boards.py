"""The verdict, one sentence that is right, and the board."""

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.report.board import verdict
from olne_bench.bench.report.leaderboard_text import format_board
from olne_bench.bench.report.page.boards import board
from olne_bench.bench.report.statistics.score import log_errors, pair_table, score_table
from olne_bench.bench.report.study import Study
from olne_bench.bench.report.tables import tabulate
from tests.bench.report.statistics.test_score import FACTORS, STUDY, trials


def said(factors: dict[str, float], spread: float = 0.05, seeds: int = 10) -> str:
    told = trials(factors)
    told = told[told["seed"] < seeds]
    noise = np.random.default_rng(0).normal(size=len(told))
    told["position_error"] *= np.exp(spread * noise)
    logs = log_errors(told, STUDY)
    return verdict(score_table(logs, STUDY), pair_table(logs, STUDY), STUDY)


def test_the_best_by_how_much_and_its_interval() -> None:
    text = said(FACTORS)
    start = "On 40 trials with noise of 2 scenarios, map has the smallest position errors: "
    assert text.startswith(start)
    assert "% smaller than those of kkt_constrained (95 % interval" in text
    assert text.endswith(" %).")


@pytest.mark.parametrize(
    ("factors", "expected"),
    [
        ({"map": 2, "bilevel": 1.5}, "kkt_constrained has the smallest position errors; those of"),
        ({"map": 1.0, "bilevel": 1.0}, "cannot be told apart from it."),
        ({"uniform": 0.1}, "; uniform, which ignores the data, has smaller ones."),
    ],
)
def test_ties_worse_ones_and_guesses_are_told(factors, expected) -> None:
    assert expected in said(FACTORS | factors)


def test_a_guess_that_fixed_weights_make_right_is_told_as_such() -> None:
    told = trials(FACTORS)
    guessed = (told["estimator"] == "uniform") & (told["scenario"] == "two_player")
    told.loc[guessed, "position_error"] *= 1e-6
    logs = log_errors(told, STUDY)
    text = verdict(score_table(logs, STUDY), pair_table(logs, STUDY), STUDY)
    assert text.endswith(
        "; uniform ignores the data and wins where the fixed true weights of two_player are near "
        "its guess."
    )


def test_few_draws_tell_nothing_and_one_estimator_is_alone() -> None:
    assert "are too few to tell estimators apart" in said(FACTORS, seeds=1)
    alone = said({"map": 1.0, "uniform": 3.0})
    assert alone == "map is the only estimator that ranks, on 40 trials with noise of 2 scenarios."


def test_the_board_has_five_columns_the_best_first_and_the_floor_last(
    small_study: pd.DataFrame, usual: Study
) -> None:
    tables = tabulate(small_study, usual)
    table = board(tables, usual)
    assert table.heads == ["Estimator", "Score", "Position error [m]", "Failures", "Time [ms]"]
    scores = [float(cells[1].key or "nan") for _, cells in table.rows]
    assert scores[:2] == sorted(scores[:2])
    assert table.rows[-1][0] == {"class": "floor"} and "uniform" in table.rows[-1][1][0].text
    text = format_board(tables, usual)
    assert text.startswith(verdict(tables.scores, tables.comparisons, usual)[:60])
    head, *rows = text.split("\n\n")[1].splitlines()
    assert head.split() == [
        "Estimator",
        "Score",
        "Position",
        "error",
        "[m]",
        "Failures",
        "Time",
        "[ms]",
    ]
    assert rows[-1].split()[:2] == ["uniform", "(floor)"] and len(rows) == len(table.rows)
    held = small_study.assign(held_out_error=0.1)
    assert board(tabulate(held, usual), usual).heads[3] == "Held-out error [m]"


def test_without_noise_there_are_errors_and_no_scores(small_study: pd.DataFrame, usual) -> None:
    quiet = small_study.assign(sigma=0.0)
    tables = tabulate(quiet[quiet["seed"] == 0], usual)
    table = board(tables, usual)
    assert table.note.startswith("Nobody has a score.")
    assert [cells[1].text for _, cells in table.rows] == ["–"] * 3
    assert "–" not in [cells[2].text for _, cells in table.rows]
    assert verdict(tables.scores, tables.comparisons, usual).startswith("No estimator has a score")
