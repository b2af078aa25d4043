"""Tables of online studies, on rows that are written down."""

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.report.online import over_time_table, summary_table
from olne_bench.bench.report.online_rows import COLUMNS


def rows() -> pd.DataFrame:
    """Two motions of four samples; one estimator halves its error, the other one once."""
    made = []
    for estimator, seed, errors in (
        ("good", 0, [0.4, 0.2, 0.1, 0.1]),
        ("good", 1, [0.4, 0.3, 0.2, 0.1]),
        ("bad", 0, [0.4, 0.4, 0.4, 0.1]),
        ("bad", 1, [0.4, 0.4, 0.4, 0.4]),
    ):
        for k, error in enumerate(errors):
            row = dict.fromkeys(COLUMNS)
            row |= {"scenario": "s", "sensor": "full", "sigma": 0.1, "estimator": estimator}
            row |= {"seed": seed, "sample": k + 1, "time": 0.5 * k, "late": k == 0}
            row |= {"status": "ok" if k < 3 else "timeout", "cosine_error": error}
            row |= {"prior_error": 0.4, "latency": 0.01 * (k + 1) if k < 3 else None}
            row |= {"fde_1s": 2.0 * error, "ade_1s": error}
            made.append(row)
    skipped = dict.fromkeys(COLUMNS) | {"scenario": "s", "estimator": "good", "seed": 2}
    skipped |= {"sensor": "full", "sigma": 0.1, "status": "skipped", "sample": 0, "late": False}
    return pd.DataFrame([*made, skipped])


def test_a_line_for_each_estimator() -> None:
    good, bad = (line for _, line in summary_table(rows()).iterrows())
    assert (good["estimator"], bad["estimator"]) == ("good", "bad")
    assert good["motions"] == 2 and good["updates"] == 8
    assert good["failed"] == 0.25 and good["late"] == 0.25
    assert good["latency_50"] == pytest.approx(20.0)
    assert good["latency_99"] == pytest.approx(30.0)
    assert good["cosine_error"] == pytest.approx(0.2)
    assert good["fde_1s"] == pytest.approx(0.4)
    assert np.isnan(good["fde_4s"])


def test_time_to_halve_the_error() -> None:
    good, bad = (line for _, line in summary_table(rows()).iterrows())
    assert good["half_time"] == pytest.approx(0.75)  # of 0.5 and 1
    assert np.isnan(bad["half_time"])  # one of two never gets there


def test_medians_over_time() -> None:
    table = over_time_table(rows())
    good = table[table["estimator"] == "good"]
    assert good["time"].tolist() == [0.0, 0.5, 1.0, 1.5]
    np.testing.assert_allclose(good["cosine_error"], [0.4, 0.25, 0.15, 0.1])
