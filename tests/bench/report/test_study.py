"""The choice of a table's metrics."""

import pandas as pd

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.study import (
    IDENTIFIABLE,
    compared,
    in_leaderboard,
    in_table,
    primary,
)

POSITION = MetricDeclaration("position_error", compared=True)
JERK = MetricDeclaration("jerk", compared=True)
TOUCHES = MetricDeclaration("touches", summary="share")


def test_estimators_are_ranked_by_the_position_error_or_the_first_that_is_compared() -> None:
    assert primary([TOUCHES, JERK, POSITION]) is POSITION
    assert primary([TOUCHES, JERK]) is JERK
    assert primary([TOUCHES]) is None
    assert compared([TOUCHES, JERK, POSITION]) == [JERK, POSITION]


def test_a_table_is_about_what_it_has_something_of() -> None:
    trials = pd.DataFrame(
        {"status": ["crash", "invalid"], "position_error": [None, None], "touches": [1.0, None]}
    )
    assert in_table([POSITION, JERK, TOUCHES], trials) == [POSITION, TOUCHES]
    assert in_table([POSITION, TOUCHES], trials.assign(touches=None)) == [POSITION]


def test_a_metric_that_does_not_apply_has_no_column() -> None:
    trials = pd.DataFrame({"status": ["ok", "crash"], "jerk": [None, None], "touches": [1.0, None]})
    assert in_table([JERK, TOUCHES], trials) == [TOUCHES]


def test_a_leaderboard_shows_what_it_summarises() -> None:
    table = pd.DataFrame(
        columns=["touches_share", "jerk_median", f"{IDENTIFIABLE.name}_median", "position_error"]
    )
    assert in_leaderboard([POSITION, JERK, TOUCHES], table) == [JERK, TOUCHES, IDENTIFIABLE]
    assert in_leaderboard([IDENTIFIABLE, JERK], table) == [IDENTIFIABLE, JERK]
