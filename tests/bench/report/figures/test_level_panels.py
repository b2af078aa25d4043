"""Panels of errors level by level: a row per metric, a column per sensor."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from olne_bench.bench.report.figures import style
from olne_bench.bench.report.figures.error_panels import Entries
from olne_bench.bench.report.figures.level_panels import draw_level_panels
from olne_bench.bench.report.figures.series import split
from olne_bench.bench.report.measures import in_table
from olne_bench.bench.report.study import USUAL


def draw(trials: pd.DataFrame) -> tuple[Figure, Entries]:
    with style.applied():
        return draw_level_panels(split(trials), in_table(USUAL.metrics, trials))


@pytest.fixture(scope="module")
def trials(make_trials) -> pd.DataFrame:
    """Trials of two contenders and the floor; one lacks two predictions, all have a share."""
    table = make_trials(estimators=("a", "ukf", "uniform"), sigmas=(0.01, 0.1), seeds=5)
    lost = (table["estimator"] == "a") & (table["sigma"] == 0.1) & (table["seed"] < 2)
    table.loc[lost, ["status", "position_error"]] = ["failed_forward", np.nan]
    return table.assign(covers_truth=(table["seed"] < 4).astype(float))


@pytest.fixture(scope="module")
def drawn(trials) -> tuple[Figure, Entries]:
    return draw(trials)


@pytest.fixture
def grid(drawn) -> np.ndarray:
    """Panels by metric and sensor."""
    return np.array(drawn[0].axes).reshape(4, 2)


def test_labels_are_told_once(grid) -> None:
    assert [axes.get_title() for axes in grid[0]] == ["full", "partial"]
    assert all(axes.get_title() == "" for axes in grid[1:].ravel())
    assert [axes.get_xlabel() for axes in grid[-1]] == ["Noise level σ [m]"] * 2
    assert all(axes.get_xlabel() == "" for axes in grid[:-1].ravel())
    assert all(axes.get_ylabel() for axes in grid[:, 0])
    assert not any(axes.get_ylabel() for axes in grid[:, 1])
    for row in grid:
        shown = [axes.yaxis.get_tick_params()["labelleft"] for axes in row]
        assert shown == [True, False]
        assert len({axes.get_ylim() for axes in row}) == 1


def test_each_panel_has_the_series_of_its_sensor(trials) -> None:
    table = trials.copy()
    partial = (table["sensor"] == "partial") & (table["sigma"] == 0.1)
    table.loc[partial, "position_error"] *= 3
    grid = np.array(draw(table)[0].axes).reshape(4, 2)
    for axes, sensor in zip(grid[0], ("full", "partial"), strict=True):
        for name in ("a", "ukf"):
            rows = table[(table["sensor"] == sensor) & (table["estimator"] == name)]
            expected = rows["position_error"].dropna()
            colour = style.estimator_colours(name)[0]
            points, medians = [line for line in axes.lines if line.get_color() == colour][:2]
            np.testing.assert_allclose(points.get_ydata(), expected)
            assert len(medians.get_ydata()) == 2


def test_there_is_room_for_the_number_of_failures(trials, grid) -> None:
    bottom, top = np.log10(grid[0, 0].get_ylim())
    highest = np.log10(trials["position_error"].max())
    lost = 1 - (highest - bottom) / (top - bottom)
    bottom, top = np.log10(grid[2, 0].get_ylim())
    highest = np.log10(trials["reconstruction_error"].max())
    kept = 1 - (highest - bottom) / (top - bottom)
    assert 0.1 < lost < 0.2
    assert 0.01 < kept < 0.06
    assert isinstance(grid[0, 0].yaxis.get_minor_locator(), NullLocator)


def test_the_floor_is_drawn_in_every_panel_of_errors_and_no_other(trials, grid) -> None:
    floors = [[line.get_color() == style.FLOOR_COLOUR for line in a.lines] for a in grid.ravel()]
    assert [sum(panel) for panel in floors] == [1] * 6 + [0] * 2
    without = draw(trials[trials["estimator"] != "uniform"])[0].axes
    assert not any(line.get_color() == style.FLOOR_COLOUR for a in without for line in a.lines)


def test_shares_have_an_interval_at_each_level(grid) -> None:
    axes = grid[3, 0]
    middles = [line for line in axes.lines if line.get_marker() not in ("None", "")]
    assert [list(line.get_ydata()) for line in middles] == [[0.8]] * 4
    assert len(axes.collections) == 4
    for bar in axes.collections:
        low, high = bar.get_datalim(axes.transData).intervaly
        assert 0 <= low < 0.8 < high <= 1


def test_figures_grow_with_metrics_and_sensors(make_trials) -> None:
    sizes = {}
    one = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.1,), seeds=2)
    one = one.drop(columns=["cosine_error", "reconstruction_error"])
    for number in (1, 2, 3, 4):
        names = ("full", "partial", "x", "y")[:number]
        table = pd.concat([one.assign(sensor=name) for name in names])
        sizes[number] = draw(table)[0].get_size_inches()
    widths = [sizes[number][0] for number in sizes]
    assert widths == sorted(set(widths))
    assert widths[0] * 2 > widths[1]
    # Panels of three and more sensors are narrower.
    assert widths[2] / 3 < widths[1] / 2 and widths[3] / 4 == pytest.approx(widths[2] / 3)
    assert len({height for _, height in sizes.values()}) == 1
    taller = draw(one.assign(cosine_error=0.1))[0].get_figheight()
    assert sizes[1][1] + 2 < taller < 2 * sizes[1][1]


def test_the_legend_has_an_entry_per_estimator(trials, drawn) -> None:
    entries = drawn[1]
    assert [name for _, name in entries] == [
        "ukf",
        "a",
        "uniform (floor)",
        "one trial",
        "median",
        "quartiles",
        "number of failures, as published",
    ]
    artists = {name: artist for artist, name in entries}
    for name in ("a", "ukf"):
        assert artists[name].get_color() == style.estimator_colours(name)[0]
        assert artists[name].get_marker() == style.estimator_marker(name)
        assert artists[name].get_linestyle() == "None"
    assert artists["one trial"].get_marker() == "."
    alone = draw(trials[trials["estimator"] == "uniform"])[1]
    assert [name for _, name in alone] == ["uniform (floor)"]
