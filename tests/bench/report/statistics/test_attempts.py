"""Attempts, their errors, and errors of the harness, which are reported and are no failures."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from olne_bench.bench.judge.metrics.cosine_error import CosineError
from olne_bench.bench.judge.metrics.declaration import declare
from olne_bench.bench.judge.metrics.position_error import PositionError
from olne_bench.bench.report.leaderboard_text import format_notes, markdown
from olne_bench.bench.report.page.render import render_page
from olne_bench.bench.report.statistics.attempts import (
    attempts_of,
    errors_of,
    harness_errors,
    in_words,
    measured,
    noisy,
    quantile,
    weighed,
)
from olne_bench.bench.report.study import FAILURES, IDENTIFIABLE
from olne_bench.bench.report.tables import tabulate
from tests.bench.report.conftest import LOST, trial_row

COSINE_ERROR, POSITION_ERROR = declare(CosineError), declare(PositionError)

errors = st.lists(st.floats(0, 10) | st.just(float("inf")), min_size=1, max_size=12)
shares = st.sampled_from([0.0, 0.25, 0.5, 0.75, 1.0])


@given(errors, shares, st.data())
def test_counted_values_are_as_good_as_repeated_ones(values, share, data):
    counts = data.draw(st.lists(st.integers(1, 4), min_size=len(values), max_size=len(values)))
    repeated = np.repeat(values, counts)
    found = quantile(np.array(values), np.array(counts), share)
    assert found == quantile(repeated, np.ones(len(repeated), int), share)
    if np.isfinite(repeated).all():
        assert found == pytest.approx(np.quantile(repeated, share))


@given(errors, shares, st.integers(0, 11))
def test_a_failure_never_makes_a_quantile_smaller(values, share, place):
    one = np.ones(len(values), int)
    worse = np.array(values)
    worse[place % len(values)] = np.inf
    assert quantile(worse, one, share) >= quantile(np.array(values), one, share)


@given(errors, shares)
def test_the_order_of_trials_does_not_matter(values, share):
    one = np.ones(len(values), int)
    assert quantile(np.array(values[::-1]), one, share) == quantile(np.array(values), one, share)


def test_most_attempts_failed_says_an_infinite_median():
    assert quantile(np.array([0.1, 0.2, np.inf, np.inf, np.inf]), np.ones(5, int), 0.5) == np.inf
    assert np.isnan(quantile(np.empty(0), np.empty(0, int), 0.5))


def test_a_forward_game_without_a_root_is_a_failure_of_the_prediction_only():
    rows = pd.DataFrame(
        {
            "status": ["ok", "failed_forward", "crash", "ok"],
            "cosine_error": [0.1, 0.2, np.nan, np.nan],
            "position_error": [0.3, np.nan, np.nan, 0.4],
        }
    )
    assert errors_of(rows, COSINE_ERROR).tolist() == [0.1, 0.2, np.inf, np.inf]
    assert errors_of(rows, POSITION_ERROR).tolist() == [0.3, np.inf, np.inf, 0.4]


def counted(rows) -> pd.DataFrame:
    columns = ["scenario", "estimator", "sigma", "seed", "count"]
    return pd.DataFrame(rows, columns=columns).assign(sensor="full")


def test_rows_without_noise_count_as_often_as_draws_were_run():
    rows = [("two_player", "a", 0.0, 0, 40)]
    rows += [("two_player", "a", sigma, seed, 1) for sigma in (0.1, 0.2) for seed in (0, 3)]
    rows += [("two_player", "b", 0.0, 0, 40), ("highway_overtaking", "a", 0.0, 0, 40)]
    trials = counted(rows)
    found = weighed(trials)
    assert found["count"].tolist() == [2, 1, 1, 1, 1, 1, 1]
    assert trials["count"].max() == 40
    whole = counted([rows[0], *[("two_player", "a", 0.1, seed, 1) for seed in range(40)]])
    assert weighed(whole).equals(whole)


def test_chance_has_no_part_in_rows_without_noise(usual):
    trials = counted(
        [
            ("two_player", "a", 0.0, 0, 1),
            ("two_player", "a", 0.1, 0, 1),
            ("two_player", "a", 0.0, 0, 40),
            ("random(num_players=3)", "a", 0.0, 0, 1),
        ]
    )
    assert noisy(trials, usual).index.tolist() == [1, 3]


def judged(rows) -> pd.DataFrame:
    columns = ["scenario", "estimator", "seed", "status", "cosine_error", "position_error"]
    return pd.DataFrame(rows, columns=columns).assign(sensor="full")


def test_what_was_declined_or_spoilt_is_no_attempt():
    statuses = ["ok", "skipped", "crash", "harness_error", "failed_forward", "timeout"]
    trials = judged([("two_player", "a", 0, status, 0.1, 0.2) for status in statuses])
    assert attempts_of(trials).index.tolist() == [0, 2, 4, 5]


def test_a_prediction_that_nobody_has_of_a_draw_is_none(usual):
    family = "random(num_players=3)"
    trials = judged(
        [
            (family, "a", 0, "ok", 0.1, np.nan),  # no estimator has one for this draw
            (family, "b", 0, "ok", 0.1, np.nan),
            (family, "a", 1, "ok", 0.1, 0.2),
            (family, "b", 1, "ok", 0.1, np.nan),  # lost, as the other has one
            (family, "b", 2, "crash", np.nan, np.nan),  # a failure of any kind
            ("two_player", "a", 0, "ok", 0.1, 0.2),
            ("two_player", "a", 1, "ok", 0.1, np.nan),  # one scenario is one draw
        ]
    )
    found = measured(trials, POSITION_ERROR, usual)
    assert found.tolist() == [False, False, True, True, True, True, True]


def test_an_error_that_an_estimator_never_has_is_none_of_its(usual):
    trials = judged(
        [
            ("two_player", "a", 0, "ok", np.nan, 0.2),
            ("two_player", "a", 1, "crash", np.nan, np.nan),
            ("two_player", "b", 0, "ok", np.nan, 0.2),
            ("two_player", "b", 1, "ok", 0.1, 0.2),
            ("two_player", "b", 2, "timeout", np.nan, np.nan),
            ("two_player", "c", 0, "crash", np.nan, np.nan),  # may have had one
        ]
    )
    found = measured(trials, COSINE_ERROR, usual)
    assert found.tolist() == [False, False, False, True, True, True]
    assert measured(trials, FAILURES, usual).all()
    told = trials.assign(**{IDENTIFIABLE.name: [0.1, np.nan, np.inf, 0.2, np.nan, np.nan]})
    assert measured(told, IDENTIFIABLE, usual).tolist() == [True, False, True, True, False, False]


def test_failures_are_ones():
    trials = judged(
        [("two_player", "a", 0, s, 0.1, 0.2) for s in ("ok", "crash", "failed_forward")]
    )
    assert errors_of(trials, FAILURES).tolist() == [0, 1, 1]


def spoilt_trials(spoilt: int) -> pd.DataFrame:
    rows = []
    for seed in range(10):
        row = trial_row(scenario="of_another_version", seed=seed)
        fault = LOST | {"status": "harness_error", "message": f"metric 'x': fault {seed // 3}"}
        rows.append(row | (fault if seed < spoilt else {}))
    return pd.DataFrame(rows)


def test_errors_of_the_harness_are_no_attempts():
    (row,) = tabulate(spoilt_trials(4)).leaderboard.to_dict("records")
    assert (row["trials"], row["failures"], row["harness_errors"]) == (6, 0, 4)
    assert row["position_error_median"] == row["position_error_mean"] == 1.0
    (clean,) = tabulate(spoilt_trials(0)).leaderboard.to_dict("records")
    assert (clean["trials"], clean["harness_errors"]) == (10, 0)


def test_errors_of_the_harness_are_counted_by_message():
    table = harness_errors(spoilt_trials(4))
    assert table["trials"].tolist() == [3, 1]
    assert in_words(table) == [
        "3 x e on of_another_version, full: metric 'x': fault 0",
        "1 x e on of_another_version, full: metric 'x': fault 1",
    ]
    assert in_words(table, most=1)[1] == "and 1 more"
    assert in_words(harness_errors(spoilt_trials(0))) == []


def test_all_reports_tell_errors_of_the_harness():
    tables = tabulate(spoilt_trials(4))
    assert "| Harness errors |" in markdown(tables.leaderboard)
    said = format_notes(tables, ["figure x: why"])
    assert "3 x e on" in said and "figure x: why" in said
    html = render_page(spoilt_trials(4), tables, [], notes=["figure x: why"]).html
    assert "fault 0" in html and "figure x: why" in html


def test_a_terminal_says_why_trials_failed():
    trials = spoilt_trials(0)
    failed = trials.assign(status="invalid", message="weights have the shape (2,)")
    said = format_notes(tabulate(pd.concat([trials, failed], ignore_index=True)), [])
    assert "Why trials failed:" in said
    assert f"{len(failed)} x e on of_another_version, full: invalid: weights have" in said


def test_nothing_is_said_where_nothing_is_wrong():
    tables = tabulate(spoilt_trials(0))
    assert format_notes(tables, []) == ""
    assert "arness" not in markdown(tables.leaderboard)
