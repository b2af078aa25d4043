"""Outcomes of trials."""

from olne_bench.bench.plan.outcome import FAILURES, OUTCOME_COLUMNS, STATUSES, Outcome

KEPT_APART = {"scores", "trial_seconds", "scene", "motion"}


def test_failures_are_attempts_that_did_not_succeed() -> None:
    assert set(STATUSES) - set(FAILURES) == {"ok", "skipped", "harness_error"}


def test_every_part_but_the_scores_has_a_column_of_its_type() -> None:
    assert set(OUTCOME_COLUMNS) == set(vars(Outcome("ok"))) - KEPT_APART
    texts = {name for name, kind in OUTCOME_COLUMNS.items() if kind == "TEXT"}
    assert texts == {"status", "message", "weights", "unknowns", "weight_levels", "extras"}
    assert set(OUTCOME_COLUMNS.values()) == {"TEXT", "REAL"}
