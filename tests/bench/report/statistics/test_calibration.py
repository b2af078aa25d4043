"""Tables of calibration."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from scipy.stats import binom

from olne_bench.bench.report.statistics.calibration import (
    calibration_table,
    coverage_curve,
    weight_levels_of,
    width_table,
)


def trials(levels: np.ndarray, estimator: str = "e") -> pd.DataFrame:
    return pd.DataFrame(
        {
            "scenario": "two_player",
            "sensor": "full",
            "estimator": estimator,
            "sigma": 0.01,
            "seed": range(len(levels)),
            "status": "ok",
            "credible_level": levels,
        }
    )


def test_shares_and_their_intervals() -> None:
    rng = np.random.default_rng(0)
    sound, bold = rng.random(400), rng.random(400) ** 0.2
    table = calibration_table(pd.concat([trials(sound), trials(bold, "bold")]))
    table = table.set_index("estimator")
    assert table["trials"].tolist() == [400, 400]
    for nominal in (50, 80, 95):
        own = table.loc["e"]
        assert own[f"covered_{nominal}"] == pytest.approx(nominal / 100, abs=0.06)
        assert own[f"covered_{nominal}_low"] < own[f"covered_{nominal}"]
        assert own[f"covered_{nominal}_high"] > nominal / 100 - 0.02
    assert table.loc["bold", "covered_80_high"] < 0.5
    assert table.loc["bold", "p_uniform"] < 1e-6 < 0.01 < table.loc["e", "p_uniform"]


def test_levels_of_single_weights() -> None:
    rng = np.random.default_rng(0)
    sound = rng.random((400, 2, 2))
    bold = sound.copy()
    bold[:, 1, 1] = 0.5 + np.sign(bold[:, 1, 1] - 0.5) * np.abs(bold[:, 1, 1] - 0.5) ** 0.3
    table = calibration_table(
        pd.concat(
            trials(rng.random(400), name).assign(weight_levels=levels.tolist(), tarp_level=tarp)
            for name, levels, tarp in (
                ("e", sound, rng.random(400)),
                ("bold", bold, rng.random(400) ** 3),
            )
        )
    ).set_index("estimator")
    for nominal in (50, 80, 95):
        assert table.loc["e", f"weights_{nominal}"] == pytest.approx(nominal / 100, abs=0.03)
    assert table.loc["bold", "weights_80_high"] < 0.8
    assert table.loc["bold", "p_weights"] < 1e-6 < 0.01 < table.loc["e", "p_weights"]
    assert table.loc["bold", "p_tarp"] < 1e-6 < 0.01 < table.loc["e", "p_tarp"]


@pytest.mark.parametrize("stored", [False, True], ids=["lists", "as read from parquet"])
def test_draws_may_have_different_numbers_of_players(stored: bool) -> None:
    rng = np.random.default_rng(0)
    levels = pd.Series([rng.random((2 + seed % 3, 2)).tolist() for seed in range(300)])
    levels.iloc[7] = None
    if stored:
        levels = levels.astype(pd.ArrowDtype(pa.list_(pa.list_(pa.float64()))))
    group = trials(rng.random(300)).assign(weight_levels=levels)
    found = weight_levels_of(group)
    assert found.shape == (299, 4, 2)
    assert np.isfinite(found).all(axis=2).sum(axis=1).tolist() == [
        2 + seed % 3 for seed in range(300) if seed != 7
    ]
    np.testing.assert_array_equal(found[1, :3], levels.iloc[1])
    (row,) = calibration_table(group).to_dict("records")
    assert row["weights_80"] == pytest.approx(0.8, abs=0.05)
    assert row["p_weights"] > 0.001


def test_failed_estimates_claim_nothing() -> None:
    table = calibration_table(
        pd.concat([trials(np.linspace(0, 1, 40)), trials(np.ones(40)).assign(status="crash")])
    )
    assert table["trials"].tolist() == [40]


def test_estimators_without_regions_have_no_row() -> None:
    told, silent = trials(np.linspace(0, 1, 40)), trials(np.full(40, np.nan), "silent")
    assert calibration_table(pd.concat([told, silent]))["estimator"].tolist() == ["e"]
    for nothing in (silent, silent.drop(columns="credible_level")):
        assert calibration_table(nothing).empty


def test_the_curve_of_calibrated_levels_is_the_diagonal() -> None:
    level, share = coverage_curve(np.linspace(0, 1, 101))
    np.testing.assert_allclose(level, share, atol=0.011)
    assert (level[0], share[0], level[-1], share[-1]) == (0, 0, 1, 1)


def test_widths_and_exact_shares_of_a_cell() -> None:
    levels = np.where(np.arange(40) < 30, 0.9, 0.99)
    told = trials(levels).assign(region_width=np.linspace(0.1, 0.3, 40))
    (row,) = width_table(told).to_dict("records")
    assert (row["trials"], row["covered"], row["width"]) == (40, 0.75, pytest.approx(0.2))
    assert calibration_table(told)["width"].tolist() == [row["width"]]
    # Clopper and Pearson: ends at which 30 of 40, or a more extreme number, has 2.5 %
    assert binom.sf(29, 40, row["covered_low"]) == pytest.approx(0.025)
    assert binom.cdf(30, 40, row["covered_high"]) == pytest.approx(0.025)


def test_only_regions_with_a_width_count() -> None:
    told = trials(np.full(20, 0.5)).assign(region_width=[0.1] * 10 + [np.nan] * 10)
    failed = trials(np.ones(20)).assign(region_width=0.1, status="crash")
    assert width_table(pd.concat([told, failed]))["trials"].tolist() == [10]
    for nothing in (failed, trials(np.ones(20)), told.drop(columns="credible_level")):
        assert width_table(nothing).empty
