"""Errors as curves over the noise, for studies with many levels and trials."""

import numpy as np
import pytest

from olne_bench.bench.report.figures import curves, style
from olne_bench.bench.report.figures.series import split
from olne_bench.bench.report.measures import in_table
from olne_bench.bench.report.study import USUAL


def draw(trials):
    with style.applied():
        return curves.draw_curves(split(trials), in_table(USUAL.metrics, trials))[0]


def legend(trials):
    entries = curves.draw_curves(split(trials), in_table(USUAL.metrics, trials))[1]
    return {text: artist for artist, text in entries}


def lines(axes, marker):
    return [line for line in axes.lines if line.get_marker() == marker]


def test_every_failure_is_a_triangle_and_every_success_a_point(make_trials):
    trials = make_trials(estimators=("a",), sensors=("full",), seeds=5)
    trials.loc[trials.index[1:4], ["status", "position_error"]] = ["failed_forward", np.nan]
    position, cosine, *_ = draw(trials).axes
    assert lines(cosine, "^") == []
    (triangles,) = lines(position, "^")
    assert len(triangles.get_xdata()) == 3
    (points,) = lines(position, "o")
    assert len(points.get_xdata()) == len(trials) - 3


def test_what_the_published_step_misses_is_a_triangle_beside_its_point(make_trials):
    trials = make_trials(estimators=("a",), sensors=("full",), seeds=5)
    trials.loc[trials.index[1:4], "published_forward"] = 0
    position, cosine, *_ = draw(trials).axes
    assert lines(cosine, "^") == []
    (triangles,) = lines(position, "^")
    assert len(triangles.get_xdata()) == 3
    (points,) = lines(position, "o")
    assert len(points.get_xdata()) == len(trials)


def test_median_breaks_where_most_fail(make_trials):
    trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.01, 0.1), seeds=60)
    trials.loc[trials["sigma"] == 0.1, "status"] = "timeout"
    position, *_ = draw(trials).axes
    (median,) = (line for line in lines(position, "None") if len(line.get_xdata()) > 1)
    good = np.isfinite(median.get_ydata())
    assert good[0]
    assert not good[-1]
    assert (
        np.diff(good.astype(int)) <= 0
    ).all()  # once more than half fail, the curve does not come back


def test_triangles_stand_above_all_points(make_trials):
    trials = make_trials(estimators=tuple("abcdefgh"), seeds=3)
    trials.loc[trials["seed"] == 1, ["status", "position_error"]] = ["failed_forward", np.nan]
    position, *_ = draw(trials).axes
    bottom, top = np.log10(position.get_ylim())
    highest = (np.log10(trials["position_error"].max()) - bottom) / (top - bottom)
    assert highest < min(line.get_ydata()[0] for line in lines(position, "^"))


def test_the_floor_is_one_level_line(make_trials):
    """It uses no observation: only the choice of trials changes with the noise."""
    trials = make_trials(estimators=("uniform",), seeds=5)
    for axes in draw(trials).axes:
        (line,) = axes.lines
        assert len(set(line.get_ydata())) == 1
        assert not axes.collections


def test_the_legend_names_what_is_there(make_trials):
    few = make_trials(estimators=("a",), sensors=("full",), seeds=5)
    assert list(legend(few)) == ["a, full"]
    assert legend(few)["a, full"].get_linestyle() == "None"  # points, but no curve
    few.loc[few.index[-1], "status"] = "crash"
    assert list(legend(few)) == ["a, full", "failed by the published definition"]
    many = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.1,), seeds=60)
    assert list(legend(many)) == ["a, full", "quartiles (rolling, 60 trials)"]
    assert legend(many)["a, full"].get_linestyle() == "-"


def test_of_many_points_some_are_drawn_all_along(make_trials):
    trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.01, 0.1), seeds=400)
    position, *_ = draw(trials).axes
    (points,) = lines(position, "o")
    number = len(points.get_xdata())
    assert number == len(trials)
    mask = np.arange(4 * curves._MOST) % 2 == 0
    shown = curves._thinned(mask)
    assert mask[shown].all()
    assert curves._MOST / 2 <= len(shown) <= curves._MOST
    assert len(set(np.diff(shown))) == 1
    np.testing.assert_array_equal(curves._thinned(mask[:10]), [0, 2, 4, 6, 8])


def test_the_lower_edge_is_a_power_of_ten_below_the_errors_under_noise(make_trials):
    trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.0, 0.1), seeds=5)
    noisy = trials["sigma"] > 0
    trials["position_error"] = np.where(noisy, 0.03, 1e-6)
    position, *_ = draw(trials).axes
    bottom, top = position.get_ylim()
    np.testing.assert_allclose(bottom, 0.01)
    assert top > 0.03
    trials["position_error"] = np.where(noisy, 0.03, 1e-4)  # trials without noise do not count
    np.testing.assert_allclose(draw(trials).axes[0].get_ylim()[0], 0.01)
    trials.loc[noisy, "position_error"] = 1e-12  # a solver's rounding
    bottom, _ = draw(trials).axes[0].get_ylim()
    np.testing.assert_allclose(bottom, 1e-5)


def medians(axes):
    """Curves, which have no marker, without empty ones."""
    return [line for line in lines(axes, "None") if len(line.get_xdata()) > 1]


def test_panels_stand_two_in_a_row(make_trials):
    trials = make_trials(estimators=("a",), sensors=("full",), seeds=3)
    one = trials.drop(columns=["cosine_error", "reconstruction_error"])
    figures = [draw(table) for table in (one, trials.drop(columns="cosine_error"), trials)]
    assert [len(figure.axes) for figure in figures] == [1, 2, 3]
    shapes = [figure.axes[0].get_gridspec().get_geometry() for figure in figures]
    assert shapes == [(1, 1), (1, 2), (2, 2)]
    heights = [figure.get_figheight() for figure in figures]
    assert heights[0] == heights[1] < heights[2] < 2 * heights[0]
    assert len({figure.get_figwidth() for figure in figures}) == 1
    for axes in figures[2].axes:
        assert axes.get_xlabel() == "Mean absolute position observation error [m]"


def test_all_observation_errors_are_within_the_panel(make_trials):
    trials = make_trials(seeds=3)
    largest = trials["observation_error"].max()
    for axes in draw(trials).axes:
        left, right = axes.get_xlim()
        assert left < 0 < largest < right
        assert right - left < 1.1 * largest
    left, right = draw(make_trials(sigmas=(0.0,))).axes[0].get_xlim()
    assert left < 0 < right


def test_points_lie_at_their_errors_and_at_the_edge_where_these_are_less(make_trials):
    trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.0, 0.1), seeds=6)
    trials["position_error"] = np.where(trials["sigma"] > 0, 0.03 + 0.01 * trials["seed"], 1e-9)
    position, *_ = draw(trials).axes
    (points,) = lines(position, "o")
    np.testing.assert_allclose(points.get_xdata(), trials["observation_error"])
    np.testing.assert_allclose(points.get_ydata(), np.maximum(trials["position_error"], 0.01))
    assert not points.get_clip_on()


def test_many_points_are_fainter_than_few(make_trials):
    looks = []
    for seeds in (150, 151):
        trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.1,), seeds=seeds)
        (points,) = lines(draw(trials).axes[0], "o")
        looks.append((points.get_alpha(), points.get_markersize()))
    assert looks[0] > looks[1]
    assert looks[0][1] > looks[1][1]


def test_failures_of_each_series_have_a_row_of_their_own(make_trials):
    trials = make_trials(estimators=tuple("abc"), sensors=("full",), seeds=3)
    lost = (trials["seed"] == 1) & (trials["estimator"] != "b")
    trials.loc[lost, ["status", "position_error"]] = ["failed_forward", np.nan]
    axes = draw(trials).axes[0]
    rows = lines(axes, "^")
    assert len(rows) == 2
    heights = [set(row.get_ydata()) for row in rows]
    assert all(len(height) == 1 for height in heights)
    (first,), (second,) = heights
    assert 0.9 < second < first < 1
    assert first - second == pytest.approx(curves._TRIANGLE_STEP)
    for row, name in zip(rows, "ac", strict=True):
        assert row.get_color() == style.estimator_colours(name)[0]
        of = trials[lost & (trials["estimator"] == name)]
        np.testing.assert_allclose(row.get_xdata(), of["observation_error"])


def test_rows_of_many_series_share_the_height_that_is_theirs(make_trials):
    names = tuple(f"e{k}" for k in range(15))
    trials = make_trials(estimators=names, sensors=("full",), sigmas=(0.1,), seeds=2)
    trials.loc[trials["seed"] == 1, ["status", "position_error"]] = ["failed_forward", np.nan]
    heights = [row.get_ydata()[0] for row in lines(draw(trials).axes[0], "^")]
    assert len(set(heights)) == len(names)
    assert max(heights) - min(heights) < curves._TRIANGLES_HEIGHT


def test_a_curve_is_the_rolling_median_within_its_quartiles(make_trials):
    trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.01, 0.1), seeds=60)
    trials["position_error"] = np.random.default_rng(0).uniform(0.02, 0.9, len(trials))
    axes = draw(trials).axes[0]
    (median,) = medians(axes)
    (series,) = split(trials)
    metric = in_table(USUAL.metrics, trials)[0]
    rolling = curves.rolling_errors(series, metric)
    assert len(rolling.x) == len(trials) - curves.WINDOW + 1
    np.testing.assert_allclose(median.get_xdata(), rolling.x)
    np.testing.assert_allclose(median.get_ydata(), rolling.median)
    assert median.get_color() == series.colour
    (band,) = axes.collections
    low, high = band.get_datalim(axes.transData).intervaly
    assert low == pytest.approx(rolling.lower.min())
    assert high == pytest.approx(rolling.upper.max())


def test_an_infinite_quartile_fills_up_to_the_edge(make_trials):
    trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.01, 0.1), seeds=60)
    trials.loc[trials["seed"] % 3 == 0, "status"] = "timeout"
    axes = draw(trials).axes[0]
    (band,) = axes.collections
    assert band.get_datalim(axes.transData).intervaly[1] == pytest.approx(axes.get_ylim()[1])
    (median,) = medians(axes)
    assert np.isfinite(median.get_ydata()).all()


def test_shares_are_means_of_each_level(make_trials):
    trials = make_trials(estimators=("a", "b"), sensors=("full",), sigmas=(0.01, 0.1), seeds=4)
    trials["covers_truth"] = (trials["seed"] < 1 + 2 * (trials["sigma"] > 0.05)).astype(float)
    trials.loc[trials["estimator"] == "b", "covers_truth"] = np.nan
    axes = next(a for a in draw(trials).axes if a.get_yscale() == "linear")
    (line,) = axes.lines
    np.testing.assert_allclose(line.get_ydata(), [0.25, 0.75])
    np.testing.assert_allclose(line.get_xdata(), [0.008, 0.08])
    assert axes.get_ylim()[1] < 1.1


def test_the_floor_has_no_points_and_the_last_entry_of_the_series(make_trials):
    trials = make_trials(estimators=("a", "uniform"), sensors=("full",), sigmas=(0.1,), seeds=60)
    trials.loc[trials["seed"] < 2, ["status", "position_error"]] = ["failed_forward", np.nan]
    entries = legend(trials)
    assert list(entries) == [
        "a, full",
        "uniform (floor)",
        "quartiles (rolling, 60 trials)",
        "failed by the published definition",
    ]
    assert entries["uniform (floor)"].get_color() == style.FLOOR_COLOUR
    axes = draw(trials).axes[0]
    assert len(lines(axes, "o")) == 1
    assert len(axes.collections) == 1
