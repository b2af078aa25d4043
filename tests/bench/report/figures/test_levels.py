"""Errors level by level, which ``errors.draw`` draws for studies with few levels or trials."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from olne_bench.bench.judge.metrics.declaration import declare
from olne_bench.bench.judge.metrics.position_error import PositionError
from olne_bench.bench.report.figures import errors, style
from olne_bench.bench.report.figures.error_panels import failed_rows
from olne_bench.bench.report.figures.levels import (
    Slots,
    draw_levels,
    has_curve,
    has_quartiles,
    level_statistics,
)
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


def test_quartiles_need_four_trials_of_a_level() -> None:
    assert not has_quartiles([series({0.1: [1.0] * 3, 0.2: [1.0] * 3})])
    assert has_quartiles([series({0.1: [1.0]}), series({0.1: [1.0], 0.2: [1.0] * 4})])
    assert has_quartiles([series({0.0: [1.0]}, count=4)])
    assert not has_curve([])


@pytest.mark.parametrize("number", [1, 2, 3, 4, 9])
def test_slots_of_a_level_are_side_by_side_and_apart_from_the_next(number: int) -> None:
    one = series({0.01: [1.0], 0.1: [1.0], 0.5: [1.0]})
    names = [f"e{k}" for k in range(number)]
    slots = Slots([one], names)
    assert slots.levels == [0.01, 0.1, 0.5]
    sigmas = np.array([0.5, 0.01])
    places = np.array([slots.places(Series(n, *_rest(one)), sigmas) for n in names])
    np.testing.assert_allclose(places.mean(axis=0), [2, 0], atol=1e-12)
    if number > 1:
        steps = np.diff(places[:, 0])
        assert (steps > 0).all()
        np.testing.assert_allclose(steps, steps[0])
        assert steps[0] <= 0.2
    assert np.ptp(places[:, 0]) < 0.8  # less than from one level to the next


def _rest(one: Series) -> tuple:
    return one.sensor, one.trials, one.colour, one.line_style, one.marker


@pytest.mark.parametrize(("levels", "turned"), [(8, 0), (9, 60)])
def test_levels_are_framed_and_labels_of_many_are_turned(levels: int, turned: int) -> None:
    one = series({0.1 * (k + 1): [1.0] for k in range(levels)})
    axes = Figure().add_subplot()
    Slots([one], ["a"]).frame(axes)
    left, right = axes.get_xlim()
    assert -1 < left < -0.5 and levels - 0.5 < right < levels
    assert left + right == pytest.approx(levels - 1)  # equal margins on both sides
    assert {label.get_rotation() for label in axes.get_xticklabels()} == {turned}
    np.testing.assert_array_equal(axes.get_xticks(), range(levels))
    borders = [line.get_xdata()[0] for line in axes.lines]
    np.testing.assert_allclose(borders, np.arange(levels - 1) + 0.5)
    assert all(line.get_zorder() <= 0 for line in axes.lines)


def levels_of(one: Series, bottom: float = 0.1, top: float = 1000.0):
    """A panel of a single series."""
    axes = Figure().add_subplot()
    axes.set_ylim(bottom, top)
    failed = failed_rows(one, POSITION_ERROR)
    draw_levels(axes, one, Slots([one], ["a"]), POSITION_ERROR, failed, bottom, top)
    return axes


def bars(axes) -> np.ndarray:
    (found,) = axes.collections
    return np.array([segment[:, 1] for segment in found.get_segments()])


def test_bars_are_quartiles_and_reach_to_the_failures_where_these_are_many() -> None:
    inf = float("inf")
    good = levels_of(series({0.1: [1, 2, 3, 4, 5], 0.2: [2.0, 3.0], 0.3: [1e-3] * 4}))
    np.testing.assert_allclose(bars(good), [[2, 4], [0.1, 0.1]])  # two trials have none
    points, medians = good.lines
    np.testing.assert_allclose(sorted(points.get_ydata()), [*[0.1] * 4, 1, 2, 2, 3, 3, 4, 5])
    np.testing.assert_allclose(medians.get_ydata(), [3, 2.5, 0.1])
    assert not good.texts
    bad = levels_of(series({0.1: [1, 2, inf, inf, inf], 0.2: [1, 1, 1, 1, inf]}))
    (low, high), (_, other) = bars(bad)
    assert low == 2 and other == 1
    share = np.log(high / 0.1) / np.log(1000 / 0.1)
    triangles = bad.lines[-1].get_ydata()
    assert 0.8 < share < triangles[0] < 1  # below the triangles, as all of the text is
    assert [text.get_text() for text in bad.texts] == ["3", "1"]
    for text, place in zip(bad.texts, (0, 1), strict=True):
        assert text.xy == (place, triangles[0])
        assert text.get_position()[0] == 0 and text.get_position()[1] < 0  # under its triangle
    assert np.isnan(bad.lines[1].get_ydata()).tolist() == [True, False]


def test_points_of_many_trials_are_fainter() -> None:
    few, many = (levels_of(series({0.1: [1.0] * n, 0.2: [1.0] * n})) for n in (40, 41))
    assert few.lines[0].get_alpha() > many.lines[0].get_alpha() > 0
    assert not few.lines[0].get_clip_on()


def test_medians_stand_out_from_points_and_bars() -> None:
    axes = levels_of(series({0.1: [1, 2, 3, 4, 5]}))
    points, medians = axes.lines
    assert medians.get_zorder() > max(points.get_zorder(), axes.collections[0].get_zorder())
    assert medians.get_markeredgecolor() == "white"
    assert medians.get_markeredgewidth() > 0 == points.get_markeredgewidth()
    assert medians.get_markersize() > points.get_markersize() / 2  # a point is half of its size
    assert axes.collections[0].get_alpha() < 0.5
    assert axes.collections[0].get_linewidth()[0] < medians.get_markersize()
