"""The page of accepted submissions: one leaderboard, and a card for each estimator submitted."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import pandas as pd

from olne_bench.bench.plan.suite import Suite, read_suite_json
from olne_bench.bench.report.figures import style
from olne_bench.bench.report.page.cards import FIELDS, card_of, measured_cost
from olne_bench.bench.report.page.template import csv_texts, script, table_rows, template
from olne_bench.bench.run.provenance import Provenance
from olne_bench.bench.submission.manifest import LEADERBOARD, PLUGINS, Submission
from olne_bench.plugins import ESTIMATOR, is_built_in

_ORDER = ["suite", "scenario", "sensor", "position_error_median"]
#: Columns of a leaderboard that the page shows; NaN for a run without one of them.
_NUMBERS = (
    *(f"{name}_median" for name in ("position_error", "held_out_error", "cosine_error")),
    *("identifiable_cosine_error_median", "solve_seconds_median"),
)


@dataclass(frozen=True)
class Accepted:
    """A submission that was accepted, and a text on how it was checked."""

    submission: Submission
    checked: str


@dataclass(frozen=True)
class _Source:
    """Where a submission's rows come from."""

    name: str
    rows: int
    run: Provenance
    salt: str
    checked: str


def accepted_page(found: Sequence[Accepted]) -> str:
    """The page as HTML.

    Args:
        found: accepted submissions, in the order in which they are listed.
    """
    boards = [_board(one.submission) for one in found]
    table = pd.concat(boards, ignore_index=True).sort_values(_ORDER, ignore_index=True)
    cards = [
        pair
        for one, board in zip(found, boards, strict=True)
        for pair in _cards(one.submission, board)
    ]
    rows: list[dict[str, Any]] = [
        row | {"colours": style.estimator_colours(row["estimator"])} for row in table_rows(table)
    ]
    return template("accepted.html").render(
        rows=rows,
        submissions=[_source(one, board) for one, board in zip(found, boards, strict=True)],
        cards=cards,
        fields=FIELDS,
        colours={c.label: style.estimator_colours(c.label.partition(" of ")[0]) for c, _ in cards},
        data={"tables": csv_texts({"accepted": table})},
        script=script(("look", "save", "board", "accepted")),
    )


def _suite(submission: Submission) -> Suite:
    return read_suite_json(submission.runs[-1].suite)


def _board(submission: Submission) -> pd.DataFrame:
    board = pd.read_csv(submission.folder / LEADERBOARD)
    for name in _NUMBERS:
        if name not in board:
            board[name] = float("nan")
    suite = _suite(submission)
    own = [e.label for e in suite.estimators if not is_built_in(ESTIMATOR, e.name)]
    return board.assign(
        submission=submission.name, suite=suite.name, submitted=board["estimator"].isin(own)
    )


def _cards(submission: Submission, board: pd.DataFrame) -> list[tuple[Any, Any]]:
    """Cards of the estimators that a submission brings, and their measured cost."""
    (*_, suite) = submission.suites(submission.folder / PLUGINS)
    return [
        (
            replace(card_of(entry), label=_named(entry.label, submission)),
            measured_cost(board, entry.label),
        )
        for entry in suite.estimators
        if not is_built_in(ESTIMATOR, entry.name) and (board["estimator"] == entry.label).any()
    ]


def _named(estimator: str, submission: Submission) -> str:
    """An estimator's name that distinguishes it from those of other submissions."""
    return estimator if estimator == submission.name else f"{estimator} of {submission.name}"


def _source(one: Accepted, board: pd.DataFrame) -> _Source:
    last = one.submission.runs[-1]
    return _Source(
        name=one.submission.name,
        rows=int(board["trials"].sum()),
        run=last,
        salt=_suite(one.submission).salt,
        checked=one.checked,
    )
