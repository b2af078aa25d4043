"""Sentences about estimators, from tables made by hand."""

import pandas as pd
import pytest

from olne_bench.bench.report.paragraphs import Paragraph, markdown_paragraphs, paragraphs
from olne_bench.bench.report.statistics.wins import win_table

INF = float("inf")


def board(*rows: tuple[object, ...]) -> pd.DataFrame:
    names = ["scenario", "estimator", "position_error_rank", "position_error_median"]
    names += ["solve_seconds_median", "covers_truth_share", "covers_truth_trials"]
    table = pd.DataFrame(rows, columns=names).assign(sensor="full")
    return table.astype({"position_error_rank": "Int64"})


BOARD = board(
    ("merge", "map", 1, 0.1, 0.040, 0.9, 20),
    ("merge", "ridge", 2, 0.2, 0.020, None, 0),
    ("merge", "uniform", 3, INF, 0.001, None, 0),
    ("highway", "map", 1, 0.1, 0.060, 0.8, 60),
    ("highway", "ridge", 1, 0.1, 0.020, None, 0),
    ("highway", "uniform", 3, 2.0, 0.003, None, 0),
)
WINS = win_table(
    pd.DataFrame(
        [
            ("position_error", scenario, *row)
            for scenario in ("merge", "highway")
            for row in (
                ("map", "ridge", 30, 10, 0),
                ("map", "uniform", 40, 0, 0),
                ("ridge", "uniform", 21, 0, 19),
            )
        ],
        columns=["error", "scenario", "estimator", "other", "won", "even", "lost"],
    )
)
NONE = WINS.iloc[:0]


def levels(*rows: tuple[object, ...]) -> pd.DataFrame:
    names = ["estimator", "scenario", "sigma", "attempts", "failures"]
    return pd.DataFrame(rows, columns=names).assign(sensor="full")


LEVELS = levels(
    ("map", "merge", 0.5, 600, 0),
    ("ridge", "merge", 0.5, 300, 0),
    ("ridge", "merge", 1.0, 300, 3),
    *(("uniform", "merge", sigma, 10, k) for k, sigma in enumerate((0.1, 0.2, 0.5, 1.0))),
    ("uniform", "highway", 1.0, 10, 9),
)


def said(found: list[Paragraph], estimator: str) -> list[str]:
    return list(next(one for one in found if one.estimator == estimator).sentences)


def test_each_estimator_has_its_sentences() -> None:
    found = paragraphs(BOARD, WINS, LEVELS)
    assert [one.estimator for one in found] == ["map", "ridge", "uniform"]
    assert said(found, "map") == [
        "It has rank 1 by position error in 2 of 2 cells of scenario and sensor, 1 of them alone.",
        "Draw by draw, it beats ridge (88 % of draws) and uniform (100 %).",
        "It fails in none of 600 trials.",
        "Its 95 % regions hold the true weights in 82 % of 80 trials.",
        "Its median time is 50 ms, in the median over 2 cells.",
        "That is 2.5 times the time of the fastest contender.",
    ]
    assert said(found, "ridge") == [
        "It has rank 1 by position error in 1 of 2 cells of scenario and sensor.",
        "Its worst rank is 2, in 1 cell: merge, full.",
        "Draw by draw, it loses to map (12 % of draws).",
        "Draw by draw, there is no significant difference to uniform (52 % of draws).",
        "It fails in 3 of 600 trials, all on merge, full, at 1 m.",
        "Its median time is 20 ms, in the median over 2 cells.",
        "It is the fastest contender in 2 of 2 cells.",
    ]
    assert said(found, "uniform") == [
        "It has rank 1 by position error in none of 2 cells of scenario and sensor.",
        "Its worst rank is 3, in 2 cells: merge, full; highway, full.",
        "Its median error is infinite in 1 cell: merge, full.",
        "Draw by draw, it loses to map (0 % of draws).",
        "Draw by draw, there is no significant difference to ridge (48 % of draws).",
        "It fails in 15 of 50 trials, most often on highway, full, at 1 m (9 of 10).",
        "Its median time is 2 ms, in the median over 2 cells.",
    ]


@pytest.mark.parametrize(
    ("rows", "sentence"),
    [
        ([("a", "merge", 1.0, 600, 1)], "It fails in 1 of 600 trials: merge, full, at 1 m."),
        (
            [("a", "merge", 0.5, 30, 1), ("a", "two", 0.5, 30, 2)],
            "It fails in 3 of 60 trials: two, full, at 0.5 m (2 of 30); "
            "merge, full, at 0.5 m (1 of 30).",
        ),
        ([], "It attempted nothing."),
    ],
)
def test_few_failures_are_all_named(rows: list, sentence: str) -> None:
    one = board(("merge", "a", 1, 0.1, 0.04, None, 0))
    assert sentence in said(paragraphs(one, NONE, levels(*rows)), "a")


def test_one_cell_without_ranks() -> None:
    alone = board(("merge", "a", None, 0.1, 0.04, None, 0), ("merge", "b", None, 0.1, INF, None, 0))
    found = paragraphs(alone, NONE, levels(("a", "merge", 1.0, 2, 0), ("b", "merge", 1.0, 2, 2)))
    assert said(found, "a") == [
        "It has no rank by position error: too few draws, or a small part of the trials.",
        "It fails in none of 2 trials.",
        "Its median time is 40 ms.",
        "It is the fastest contender in this cell.",
    ]
    assert said(found, "b")[1:] == [
        "It fails in 2 of 2 trials, all on merge, full, at 1 m.",
        "Its median time is ∞ ms.",
    ]


def test_markdown_escapes_names() -> None:
    text = markdown_paragraphs([Paragraph("kkt_<b>", ("It beats a_b.", "It fails."))])
    assert text == "\n**kkt\\_\\<b\\>.** It beats a\\_b. It fails.\n"


def test_no_leaderboard_no_words() -> None:
    assert paragraphs(BOARD.iloc[:0], NONE, levels()) == []
