"""The page of accepted submissions: one leaderboard, and a card for each estimator submitted."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import pandas as pd
from markupsafe import Markup

from olne_bench.bench.plan.suite import Suite, read_suite_json
from olne_bench.bench.report.page import tables as t
from olne_bench.bench.report.page.cards import Card, card_of
from olne_bench.bench.report.page.template import csv_texts, study_page
from olne_bench.bench.submission.manifest import LEADERBOARD, PLUGINS, Submission
from olne_bench.plugins import ESTIMATOR, is_built_in

_LEAD = (
    "Runs that others have sent in. Before a run was accepted, a sample of its rows was run again, "
    "unchanged and with a fresh salt. Medians are over all attempts, failures included; less is "
    "better. Rows of one suite and one salt have the same noise."
)
_ORDER = ["suite", "scenario", "sensor", "position_error_score", "position_error_median"]
#: Columns of a leaderboard that the page shows; NaN for a run without one of them.
_NUMBERS = (
    *(f"position_error_score{end}" for end in ("", "_low", "_high")),
    *(f"{name}_median" for name in ("position_error", "held_out_error", "cosine_error")),
    *("identifiable_cosine_error_median", "solve_seconds_median"),
)


@dataclass(frozen=True)
class Accepted:
    """A submission that was accepted, and a text on how it was checked."""

    submission: Submission
    checked: str


def accepted_page(found: Sequence[Accepted]) -> str:
    """The page as HTML."""
    boards = [_board(one.submission) for one in found]
    table = pd.concat(boards, ignore_index=True).sort_values(_ORDER, ignore_index=True)
    columns: dict[str, t.Content] = {
        "Scenario": "scenario",
        "Sensor": "sensor",
        "Estimator": lambda r: t.Cell(t.named(r["estimator"], "built in" * (not r["submitted"]))),
        "Submission": "submission",
        "Suite": "suite",
        "Score": t.ends("position_error_score"),
        "Position error [m]": "position_error_median",
        "Held-out error [m]": "held_out_error_median",
        "Cosine error": "cosine_error_median",
        "Identifiable": "identifiable_cosine_error_median",
        "Failures": lambda row: t.number(
            row["failures"], Markup("{}<small> / {}</small>").format(row["failures"], row["trials"])
        ),
        "Time [ms]": lambda row: t.number(1e3 * row["solve_seconds_median"]),
    }
    return study_page(
        title="Accepted submissions",
        lead=_LEAD,
        facts=[(len(found), f"submission{'s' * (len(found) != 1)}"), (len(table), "rows")],
        sections=[("leaderboard", "Leaderboard"), ("provenance", "Provenance")],
        board=t.table_of(table, columns, name="accepted", quiet=lambda row: not row["submitted"]),
        remarks=[_source(one, board) for one, board in zip(found, boards, strict=True)],
        cards=[card for one in found for card in _cards(one.submission)],
        runs=[one.submission.runs[-1] for one in reversed(found)],
        data={"tables": csv_texts({"accepted": table})},
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


def _cards(submission: Submission) -> list[Card]:
    """Cards of the estimators that a submission brings."""
    (*_, suite) = submission.suites(submission.folder / PLUGINS)
    return [
        replace(card_of(entry), label=_named(entry.label, submission))
        for entry in suite.estimators
        if not is_built_in(ESTIMATOR, entry.name)
    ]


def _named(estimator: str, submission: Submission) -> str:
    """An estimator's name that distinguishes it from those of other submissions."""
    return estimator if estimator == submission.name else f"{estimator} of {submission.name}"


def _source(one: Accepted, board: pd.DataFrame) -> str:
    """Where a submission's rows come from, and how they were checked."""
    salt, rows = _suite(one.submission).salt, int(board["trials"].sum())
    return f"{one.submission.name}: {rows} rows, salt {salt}. {one.checked}"
