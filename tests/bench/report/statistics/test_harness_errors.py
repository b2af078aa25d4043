"""Errors of the harness are reported, and are not failures of an estimator."""

import numpy as np
import pandas as pd

from olne_bench.bench.report.leaderboard_text import format_leaderboard, format_notes, markdown
from olne_bench.bench.report.page.render import render_page
from olne_bench.bench.report.statistics.harness_errors import harness_errors, in_words
from olne_bench.bench.report.tables import tabulate


def trials(spoilt: int) -> pd.DataFrame:
    rows = [
        {
            "suite": "s",
            "scenario": "of_another_version",
            "sensor": "full",
            "estimator": "e",
            "sigma": 0.05,
            "seed": seed,
            "status": "harness_error" if seed < spoilt else "ok",
            "message": f"metric 'x': fault {seed // 3}" if seed < spoilt else "",
            "cosine_error": np.nan if seed < spoilt else 0.1,
            "cosine_limit": 0.05,
            "position_error": np.nan if seed < spoilt else 1.0,
            "observation_error": 0.04,
            "published_forward": np.nan if seed < spoilt else 1.0,
            "solve_seconds": 0.1,
            "count": 1,
            "weights": None,
        }
        for seed in range(10)
    ]
    return pd.DataFrame(rows)


def test_they_are_no_attempts():
    (row,) = tabulate(trials(4)).leaderboard.to_dict("records")
    assert (row["trials"], row["failures"], row["harness_errors"]) == (6, 0, 4)
    assert row["position_error_median"] == row["position_error_mean"] == 1.0
    (clean,) = tabulate(trials(0)).leaderboard.to_dict("records")
    assert (clean["trials"], clean["harness_errors"]) == (10, 0)


def test_they_are_counted_by_message():
    table = harness_errors(trials(4))
    assert table["trials"].tolist() == [3, 1]
    assert in_words(table) == [
        "3 x e on of_another_version, full: metric 'x': fault 0",
        "1 x e on of_another_version, full: metric 'x': fault 1",
    ]
    assert in_words(table, most=1)[1] == "and 1 more"
    assert in_words(harness_errors(trials(0))) == []


def test_all_reports_say_so():
    tables = tabulate(trials(4))
    assert "Harness errors" in format_leaderboard(tables.leaderboard)
    assert "| Harness errors |" in markdown(tables.leaderboard)
    said = format_notes(tables, ["figure x: why"])
    assert "3 x e on" in said and "figure x: why" in said
    html = render_page(trials(4), tables, [], notes=["figure x: why"]).html
    assert "fault 0" in html and "figure x: why" in html


def test_nothing_is_said_where_nothing_is_wrong():
    tables = tabulate(trials(0))
    assert format_notes(tables, []) == ""
    for text in (format_leaderboard(tables.leaderboard), markdown(tables.leaderboard)):
        assert "arness" not in text
