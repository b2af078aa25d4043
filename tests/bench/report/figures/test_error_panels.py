"""Scales, the floor and failures, which panels of errors share."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from olne_bench.bench.judge.metrics.cosine_error import CosineError
from olne_bench.bench.judge.metrics.covers_truth import CoversTruth
from olne_bench.bench.judge.metrics.declaration import declare
from olne_bench.bench.judge.metrics.position_error import PositionError
from olne_bench.bench.report.figures import error_panels as panels
from olne_bench.bench.report.figures.series import Series, split

POSITION, COSINE, COVERS = declare(PositionError), declare(CosineError), declare(CoversTruth)


def series(errors: list[float], sigma: float | list[float] = 0.1, name: str = "a") -> Series:
    """Position errors of one estimator; an infinite one is a failed prediction."""
    values = np.array(errors)
    rows = pd.DataFrame(
        {
            "scenario": "two_player",
            "sensor": "full",
            "estimator": name,
            "sigma": sigma,
            "seed": range(len(values)),
            "status": np.where(np.isfinite(values), "ok", "failed_forward"),
            "published_forward": np.isfinite(values).astype(int),
            "position_error": np.where(np.isfinite(values), values, np.nan),
            "cosine_error": 0.2,
            "covers_truth": 1.0,
            "observation_error": 0.08,
            "count": 1,
        }
    )
    (found,) = split(rows)
    return found


@pytest.mark.parametrize(("least", "edge"), [(0.03, 0.01), (0.01, 0.01), (7.0, 1.0), (2e-4, 1e-4)])
def test_the_lower_limit_is_a_power_of_ten_below_errors_under_noise(
    least: float, edge: float
) -> None:
    several = [series([8.0, np.inf, least]), series([9.0, 1e-3], sigma=[0.1, 0.0])]
    assert panels.lower_limit(several, POSITION) == pytest.approx(edge)


def test_errors_that_are_rounding_have_no_say_in_the_lower_limit() -> None:
    tiny = POSITION.negligible
    assert panels.lower_limit([series([tiny, 0.5])], POSITION) == pytest.approx(0.1)
    assert panels.lower_limit([series([2 * tiny, 0.5])], POSITION) == pytest.approx(tiny)
    for nothing in ([tiny / 2], [np.inf]):
        assert panels.lower_limit([series(nothing)], POSITION) == tiny


@pytest.mark.parametrize("reserved", [0.03, 0.3])
def test_a_share_of_the_height_is_kept_above_the_highest_point(reserved: float) -> None:
    several = [series([0.02, np.inf, 4.0]), series([0.5])]
    top = panels.upper_limit(several, POSITION, 0.01, reserved)
    height = (np.log10(4.0) - np.log10(0.01)) / (np.log10(top) - np.log10(0.01))
    assert height == pytest.approx(1 - reserved)
    for low in ([0.02], [1e-6], [np.inf]):  # at least one decade is shown
        flat = panels.upper_limit([series(low)], POSITION, 0.01, reserved)
        assert np.log10(flat / 0.01) == pytest.approx(1 / (1 - reserved))


def test_shares_are_read_as_percentages_from_none_to_all() -> None:
    axes = Figure().add_subplot()
    panels.share_scale(axes)
    low, high = axes.get_ylim()
    assert -0.1 < low < 0 < 1 < high < 1.1
    text = axes.yaxis.get_major_formatter()
    assert [text(share) for share in (0.0, 0.25, 1.0)] == ["0%", "25%", "100%"]


def test_the_floor_is_a_line_at_its_median_above_the_lower_edge() -> None:
    floor = series([0.3, 0.5, 0.1, np.inf, 0.2], name="uniform")
    assert panels.floor_error(floor, POSITION) == pytest.approx(0.3)
    axes = Figure().add_subplot()
    panels.draw_floor(axes, floor, POSITION, 0.01)
    panels.draw_floor(axes, series([1e-7], name="uniform"), POSITION, 0.01)
    panels.draw_floor(axes, series([np.inf], name="uniform"), POSITION, 0.01)  # has no line
    assert [list(line.get_ydata()) for line in axes.lines] == [[0.3, 0.3], [0.01, 0.01]]
    for line in axes.lines:
        assert line.get_color() == floor.colour
        assert line.get_linestyle() == "-"
        assert not line.get_clip_on()
        assert line.get_zorder() > axes.patch.get_zorder()


def test_failures_of_predictions_are_none_of_weights() -> None:
    some = series([0.3, np.inf, 0.1])
    assert panels.failed_rows(some, POSITION).tolist() == [False, True, False]
    assert panels.failed_rows(some, COSINE).tolist() == [False, False, False]
    some.trials.loc[some.trials.index[2], "status"] = "timeout"
    assert panels.failed_rows(some, POSITION).tolist() == [False, True, True]
    assert panels.failed_rows(some, COSINE).tolist() == [False, False, True]
    some.trials.loc[some.trials.index[0], "published_forward"] = 0
    assert panels.failed_rows(some, POSITION).all()


def test_the_legend_has_triangles_where_an_error_has_failed() -> None:
    good, bad = series([0.3]), series([0.3, np.inf])
    assert panels.failed_entry([good], [POSITION, COSINE], "lost") == []
    assert panels.failed_entry([bad], [COSINE], "lost") == []
    assert panels.failed_entry([bad], [COVERS], "lost") == []
    ((artist, text),) = panels.failed_entry([good, bad], [COVERS, COSINE, POSITION], "lost")
    assert text == "lost"
    assert artist.get_marker() == "^" and artist.get_linestyle() == "None"  # type: ignore[attr-defined]
    floor = series([0.3], name="uniform")
    line, name = panels.floor_entry(floor)
    assert name == "uniform (floor)" and line.get_color() == floor.colour  # type: ignore[attr-defined]
