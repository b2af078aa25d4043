"""Figures of calibration."""

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.report.figures.calibration import draw_coverage, draw_widths
from olne_bench.bench.report.formats import NotDrawnError

NUMBER = 60


@pytest.fixture
def told() -> pd.DataFrame:
    """Two estimators that are calibrated, of which one has samples, and one that says nothing."""
    rng = np.random.default_rng(0)
    frames = []
    for estimator in ("kkt_constrained", "posterior", "uniform"):
        for sensor in ("full", "partial"):
            silent = estimator == "uniform"
            frames.append(
                pd.DataFrame(
                    {
                        "suite": "test",
                        "scenario": "two_player",
                        "sensor": sensor,
                        "estimator": estimator,
                        "sigma": 0.1,
                        "seed": range(NUMBER),
                        "status": "ok",
                        "credible_level": np.nan if silent else rng.random(NUMBER),
                        "region_width": np.nan if silent else rng.lognormal(-3, 0.1, NUMBER),
                        "tarp_level": rng.random(NUMBER) if estimator == "posterior" else np.nan,
                        "weight_levels": [
                            rng.random((2, 3)).tolist() if estimator == "posterior" else None
                            for _ in range(NUMBER)
                        ],
                    }
                )
            )
    return pd.concat(frames)


def test_a_curve_for_each_region_and_for_random_points_and_a_line_for_each_weight(told) -> None:
    above, below = np.reshape(draw_coverage(told).axes, (2, 2))
    assert [axes.get_title() for axes in above] == ["full", "partial"]
    for axes in above:  # the diagonal, two regions, and one around random points
        assert [line.get_linestyle() for line in axes.lines].count(":") == 1
        assert len(axes.lines) == 4
    for axes in below:
        assert len(axes.lines) == 1 + 2 * 3
        for line in axes.lines[1:]:
            assert np.abs(line.get_ydata()[[0, -1]]).max() < 1e-12


def test_a_player_of_some_draws_has_its_lines(told: pd.DataFrame) -> None:
    more = [np.full((3, 3), 0.5).tolist() if k % 2 else [[0.1] * 3] * 2 for k in range(NUMBER)]
    told.loc[told["estimator"] == "posterior", "weight_levels"] = pd.Series(more * 2).values
    for axes in draw_coverage(told).axes[2:]:
        assert len(axes.lines) == 1 + 3 * 3


def test_the_band_of_weights_counts_a_draw_once_at_all_its_noise_levels(told) -> None:
    bands = [
        draw_coverage(table).axes[2].collections[0].get_paths()[0].vertices
        for table in (told, pd.concat([told, told.assign(sigma=0.2)]))
    ]
    np.testing.assert_array_equal(*bands)


def test_a_point_with_bars_for_each_noise_level(told: pd.DataFrame) -> None:
    louder = told.assign(sigma=0.2, region_width=2 * told["region_width"])
    figure = draw_widths(pd.concat([told, louder]))
    assert [axes.get_title() for axes in figure.axes] == ["full", "partial"]
    for axes in figure.axes:
        assert len(axes.containers) == 2 * 2  # estimators and noise levels; uniform says nothing
        places = np.array([bar.lines[0].get_xydata()[0] for bar in axes.containers])
        for near, far in places.reshape(2, 2, 2):
            assert far[0] == pytest.approx(2 * near[0])
            assert far[1] == near[1] > 0.8


def test_nothing_to_draw_is_said(told: pd.DataFrame) -> None:
    silent = told[told["estimator"] == "uniform"]
    for draw in (draw_coverage, draw_widths):
        with pytest.raises(NotDrawnError):
            draw(silent)
