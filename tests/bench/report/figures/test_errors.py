import numpy as np

from olne_bench.bench.report.figures import errors, style


def draw(trials):
    with style.applied():
        return errors.draw(trials)


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


def test_the_floor_is_a_line_only(make_trials):
    trials = make_trials(estimators=("uniform",), seeds=5)
    for axes in draw(trials).axes:
        assert len(axes.lines) == 1
        assert not axes.collections
