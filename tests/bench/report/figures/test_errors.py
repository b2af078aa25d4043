"""Errors as curves, which ``errors.draw`` makes of studies with many levels and trials."""

import numpy as np

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
    assert (np.diff(good.astype(int)) <= 0).all()  # once more than half fail, it stays away


def test_triangles_stand_above_all_points(make_trials):
    trials = make_trials(estimators=tuple("abcdefgh"), seeds=3)
    trials.loc[trials["seed"] == 1, ["status", "position_error"]] = ["failed_forward", np.nan]
    position, *_ = draw(trials).axes
    bottom, top = np.log10(position.get_ylim())
    highest = (np.log10(trials["position_error"].max()) - bottom) / (top - bottom)
    assert highest < min(line.get_ydata()[0] for line in lines(position, "^"))


def test_the_floor_is_one_level_line(make_trials):
    """It looks at no observation: what changes along the noise is the choice of trials only."""
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
    trials["position_error"] = np.where(noisy, 0.03, 1e-4)  # those without noise have no say
    np.testing.assert_allclose(draw(trials).axes[0].get_ylim()[0], 0.01)
    trials.loc[noisy, "position_error"] = 1e-12  # a solver's rounding
    bottom, _ = draw(trials).axes[0].get_ylim()
    np.testing.assert_allclose(bottom, 1e-5)
