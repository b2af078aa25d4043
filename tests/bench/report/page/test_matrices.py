"""Rows of the page's matrices, from tables made by hand."""

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.report.page.matrices import SEEN, driver_rows, win_rows
from olne_bench.bench.report.statistics.wins import win_table

COUNTS = ["error", "scenario", "estimator", "other", "won", "even", "lost"]


def test_a_share_and_its_opposite() -> None:
    rows = [("e", place, "a", "b", 6, 2, 2) for place in ("one", "two")]
    table = win_table(pd.DataFrame(rows, columns=COUNTS))
    found = win_rows(table, ["b", "a", "c"])
    assert [(row.scenario, row.estimator) for row in found] == [
        ("", "b"),
        ("", "a"),
        ("one", "b"),
        ("one", "a"),
        ("two", "b"),
        ("two", "a"),
    ]
    own, against, missing = found[1].cells
    assert (against, missing) == (None, None) and own is not None
    back = found[0].cells[1]
    assert back is not None and back.wins == pytest.approx(0.3) and own.wins == pytest.approx(0.7)
    assert (back.low, back.high) == pytest.approx((1 - own.high, 1 - own.low))
    assert own.low < own.wins < own.high and own.draws == 20


def test_drivers_are_counted_over_all_noise_levels() -> None:
    place = {"scenario": "road", "sensor": "full", "estimator": "a"}
    errors = pd.DataFrame(
        [
            {**place, "sigma": sigma, "temperament": name, "cosine_error_median": error}
            for sigma, error in ((np.nan, 0.3), (0.1, 0.2), (0.2, 0.4))
            for name in ("aggressive", "cautious")
        ]
    )
    seen = [("aggressive", 0.1, "aggressive", 3), ("aggressive", 0.2, "normal", 1)]
    seen += [("cautious", 0.1, "none", 2)]
    names = ["temperament", "sigma", "recognised", "drivers"]
    confusions = pd.DataFrame(seen, columns=names).assign(**place)
    (row,) = driver_rows(errors, confusions)
    assert (row.scenario, row.sensor, row.estimator) == ("road", "full", "a")
    first, normal, last = row.drivers
    assert SEEN == ("aggressive", "normal", "cautious", "none")
    assert normal is None and first is not None and last is not None
    assert (first.error, first.seen) == (0.3, (0.75, 0.25, 0.0, 0.0))
    assert last.seen == (0.0, 0.0, 0.0, 1.0)


def test_without_tables_there_are_no_rows() -> None:
    empty = pd.DataFrame(columns=["scenario", "sensor", "sigma", "estimator", "temperament"])
    more = empty.assign(recognised=None, drivers=None)
    assert driver_rows(empty.assign(cosine_error_median=None), more) == []
    assert win_rows(win_table(pd.DataFrame(columns=COUNTS)), ["a"]) == []
