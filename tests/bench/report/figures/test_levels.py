"""Errors level by level, which ``errors.draw`` makes of studies with few levels or trials."""

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.judge.metrics.declaration import declare
from olne_bench.bench.judge.metrics.position_error import PositionError
from olne_bench.bench.report.figures import errors, style
from olne_bench.bench.report.figures.error_panels import failed_rows
from olne_bench.bench.report.figures.levels import has_curve, level_statistics
from olne_bench.bench.report.figures.series import Series, split

POSITION_ERROR = declare(PositionError)


def series(levels: dict[float, list[float]], count: int = 1) -> Series:
    """One estimator's position errors by noise level; an infinite one is a failure."""
    rows = [
        {
            "scenario": "two_player",
            "sensor": "full",
            "estimator": "a",
            "sigma": sigma,
            "seed": seed,
            "status": "ok" if np.isfinite(error) else "failed_forward",
            "published_forward": 1,
            "position_error": error if np.isfinite(error) else np.nan,
            "observation_error": 0.8 * sigma,
            "count": count,
        }
        for sigma, errors in levels.items()
        for seed, error in enumerate(errors)
    ]
    (found,) = split(pd.DataFrame(rows))
    return found


def test_quartiles_take_failures_for_infinite_and_need_four_trials() -> None:
    inf = float("inf")
    one = series({0.01: [1, 2, 3, 4, 5], 0.02: [1.0, 3.0], 0.1: [2, inf, inf, inf, inf]})
    told = level_statistics(one, POSITION_ERROR, failed_rows(one, POSITION_ERROR))
    assert told.sigma.tolist() == [0.01, 0.02, 0.1]
    assert told.x == pytest.approx([0.008, 0.016, 0.08])
    assert told.median.tolist() == [3, 2, inf]
    np.testing.assert_equal(told.lower, [2, np.nan, inf])
    np.testing.assert_equal(told.upper, [4, np.nan, inf])
    assert told.failed.tolist() == [0, 0, 4]


@pytest.mark.parametrize(
    ("levels", "seeds", "curve"), [(22, 40, True), (22, 5, False), (6, 40, False), (10, 12, True)]
)
def test_curves_need_levels_and_trials(levels: int, seeds: int, curve: bool) -> None:
    one = series({0.01 * (k + 1): [1.0] * seeds for k in range(levels)})
    assert has_curve([one]) is curve


@pytest.fixture(scope="module")
def drawn(make_trials):
    trials = make_trials(estimators=("a", "kkt_residual", "uniform"), sigmas=(0.01, 0.1), seeds=5)
    lost = (trials["estimator"] == "a") & (trials["sigma"] == 0.1) & (trials["seed"] < 2)
    trials.loc[lost, ["status", "position_error"]] = ["failed_forward", np.nan]
    with style.applied():
        return errors.draw(trials)


def test_a_panel_for_each_metric_and_sensor(drawn) -> None:
    titles = [axes.get_title() for axes in drawn.axes]
    assert titles == ["full", "partial", *[""] * 4]
    assert len({axes.get_ylim() for axes in drawn.axes[:2]}) == 1  # one scale
    assert [axes.get_ylabel() for axes in drawn.axes[::2]] == [
        "Position error [m]",
        "Cosine error",
        "Reconstruction error [m]",
    ]
    shown = [text.get_text() for text in drawn.axes[0].get_xticklabels()]
    assert shown == ["0.01", "0.1"]


def test_medians_points_and_counts_stand_at_their_levels(drawn) -> None:
    axes = drawn.axes[0]
    colour = style.estimator_colours("a")[0]
    own = [line for line in axes.lines if line.get_color() == colour]
    points, medians, triangles = own
    assert len(points.get_xdata()) == 8  # two of ten failed
    place = medians.get_xdata()
    assert place == pytest.approx(triangles.get_xdata()[0] + np.array([-1, 0]))
    assert [text.get_text() for text in axes.texts if text.get_color() == colour] == ["2"]
    (residual,) = {
        line.get_xdata()[0]
        for line in axes.lines
        if line.get_color() == style.estimator_colours("kkt_residual")[0]
    }
    assert residual != place[0]  # side by side
    (floor,) = [line for line in axes.lines if line.get_color() == style.FLOOR_COLOUR]
    assert len(set(floor.get_ydata())) == 1


def test_the_legend_names_what_is_there(drawn, make_trials) -> None:
    def names(figure):
        return [text.get_text() for text in figure.legends[0].get_texts()]

    all_kinds = ["kkt_residual", "a", "uniform (floor)", "one trial", "median", "quartiles"]
    assert names(drawn) == [*all_kinds, "number of failures, as published"]
    few = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.1,), seeds=2)
    with style.applied():
        assert names(errors.draw(few)) == ["a", "one trial", "median"]
