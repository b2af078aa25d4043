"""Tables of online studies, on rows that are written down."""

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.report.stream_tables import (
    COLUMNS,
    comparison_table,
    over_time_table,
    summary_table,
)


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


def compared_rows(factor: float = 0.25, draws: int = 8) -> pd.DataFrame:
    """One estimator, whose errors are a share of constant velocity's, and fits at every 2nd."""
    made = []
    for seed in range(draws):
        for sample in range(1, 7):
            for name, error in (
                ("good", factor * (1 + seed)),
                ("constant_velocity", 1.0 + seed),
                ("stock_fitted", 0.2 * (1 + seed) if sample % 2 == 0 else None),
            ):
                if error is None:
                    continue
                row = dict.fromkeys(COLUMNS)
                row |= {"scenario": "s", "sensor": "full", "sigma": 0.1, "estimator": name}
                row |= {"seed": seed, "sample": sample, "time": 0.5 * sample, "late": False}
                made.append(
                    row | {"status": "ok", "fde_3s": error, "cosine_error": 0.1, "prior_error": 0.4}
                )
    return pd.DataFrame(made)


def test_a_third_of_constant_velocity_has_to_be_undercut() -> None:
    table = comparison_table(compared_rows()).set_index("other")
    assert table.loc["constant_velocity", ["pairs", "units", "wins"]].tolist() == [8, 8, 1.0]
    assert table.loc["constant_velocity", "ratio"] == pytest.approx(0.25)
    assert table.loc["constant_velocity", "p"] == pytest.approx(2 / 2**8)
    assert table.loc["stock_fitted", "wins"] == 0.0  # 0.25 against 0.2, at the same samples
    assert table["p_holm"].tolist() == pytest.approx([2 * 2 / 2**8] * 2)
    half = comparison_table(compared_rows(factor=0.5)).set_index("other")
    assert half.loc["constant_velocity", "wins"] == 0.0


def test_an_estimator_without_a_prediction_loses() -> None:
    rows = compared_rows()
    rows.loc[(rows["estimator"] == "good") & (rows["seed"] < 4), "fde_3s"] = None
    table = comparison_table(rows).set_index("other")
    assert table.loc["constant_velocity", "wins"] == 0.5
    assert table.loc["constant_velocity", "ratio"] > 1e9


def test_samples_of_a_motion_do_not_count_as_motions() -> None:
    line = summary_table(compared_rows()).set_index("estimator").loc["good"]
    assert line["motions"] == 8 and line["updates"] == 48
    assert line["fde_3s"] == pytest.approx(0.25 * 4.5)
    assert (line["fde_3s_low"], line["fde_3s_high"]) == pytest.approx((0.25, 0.25 * 8))
