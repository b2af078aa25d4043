"""The style of all figures."""

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from olne_bench.bench.report.figures import style
from olne_bench.envs.worlds.scene import PLAYER_COLOURS
from olne_bench.plugins import ESTIMATOR, names


def test_estimators_have_an_order_and_keep_their_looks() -> None:
    names = ["ukf", "uniform", "kkt_residual", "ukf", "a", "kkt_constrained"]
    order = ["kkt_constrained", "kkt_residual", "ukf", "a", "uniform"]
    assert style.estimator_order(names) == order
    assert style.estimator_colours("uniform") == (style.FLOOR_COLOUR,) * 2
    assert style.estimator_colours("kkt_residual") == ("#D55E00", "#E69F00")
    # Only the name decides on the colours of plugins, which differ from those of built-in ones.
    strangers = {f"e{k}": style.estimator_colours(f"e{k}") for k in range(40)}
    assert set(strangers.values()) == set(style.FOREIGN_COLOURS)
    assert strangers["e0"] == ("#215605", "#8FB07E")
    looks = {(strangers[name], style.estimator_marker(name)) for name in strangers}
    assert len(looks) > 25
    known = [style.estimator_marker(name) for name in style.ESTIMATOR_COLOURS]
    assert len(set(known)) == len(known)


def test_every_estimator_of_this_package_has_colours_of_its_own() -> None:
    assert set(names(ESTIMATOR)) - {"uniform", "ignorant"} == set(style.ESTIMATOR_COLOURS)


def test_no_player_looks_like_an_estimator() -> None:
    """Distances in the space of red, green and blue, each from 0 to 255."""
    pairs = [*style.ESTIMATOR_COLOURS.values(), *style.FOREIGN_COLOURS]
    estimators = np.array([to_rgb(c) for pair in pairs for c in (*pair, style.FLOOR_COLOUR)])
    for colour in PLAYER_COLOURS:
        assert 255 * np.linalg.norm(estimators - to_rgb(colour), axis=1).min() > 45, colour
    assert len(set(PLAYER_COLOURS)) == len(PLAYER_COLOURS) == 8  # as many as a road holds


def test_names_are_printed_on_one_line_of_bounded_length() -> None:
    assert style.printable("a\nb") == "a b"
    assert style.printable(" \x00 ") == "(no name)"
    assert style.printable("a" * 32) == "a" * 32
    assert style.printable("a" * 33) == "a" * 31 + "…"


def test_the_lowest_tick_stands_for_all_below() -> None:
    axes = Figure().add_subplot()
    style.log_axis(axes, 1e-9, 10.0)
    assert axes.get_yscale() == "log"
    assert axes.get_ylim() == (1e-9, 10.0)
    text = axes.yaxis.get_major_formatter()
    assert [text(y, 0) for y in (1e-9, 1e-8, 1.0)] == ["≤ 10⁻⁹", "10⁻⁸", "10⁰"]


@pytest.mark.parametrize(("count", "columns", "rows"), [(1, 1, 1), (6, 6, 1), (7, 6, 2)])
def test_a_figure_grows_by_its_legend(count: int, columns: int, rows: int) -> None:
    figure = Figure(figsize=(8.0, 3.0))
    names = [f"_{k}" for k in range(count)]
    style.legend_below(figure, [(Line2D([], []), name) for name in names])
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == names
    assert legend._ncols == columns
    assert figure.get_figheight() == pytest.approx(3 + 0.19 * rows)


def test_settings_hold_only_where_they_are_applied(tmp_path) -> None:
    before = dict(matplotlib.rcParams)
    with style.applied():
        assert matplotlib.rcParams["font.size"] == 9
        assert not matplotlib.rcParams["text.parse_math"]
        figure = Figure()
        figure.add_subplot().set_title("a $ b \U0010ffff")
        paths = style.save(figure, tmp_path / "a", ("png", "svg"))
    assert dict(matplotlib.rcParams) == before
    assert [path.name for path in paths] == ["a.png", "a.svg"]
    assert all(path.stat().st_size > 1000 for path in paths)


def test_markers_differ_and_dashes_are_told_apart_by_their_lengths() -> None:
    assert len(set(style.MARKERS)) == len(style.MARKERS)
    solid, *dashed = style.LINE_STYLES
    assert solid == "-"
    patterns = [pattern for _, pattern in dashed]
    assert all(offset == 0 for offset, _ in dashed)
    longest = [max(pattern[::2]) for pattern in patterns]
    assert longest[0] >= 3 * longest[1]  # dashes and dots
    assert len(patterns[2]) == 4 and longest[2] >= 3 * min(patterns[2][::2])  # both in turn
    assert all(1 <= gap <= 2 for pattern in patterns for gap in pattern[1::2])


def test_a_saved_figure_has_no_date_and_its_resolution(tmp_path) -> None:
    with style.applied():
        figure = Figure(figsize=(2.0, 1.0))
        figure.add_subplot().plot([0, 1], rasterized=True)
        paths = style.save(figure, tmp_path / "a", ("png", "svg", "pdf"))
        first = {path: path.read_bytes() for path in paths}
        style.save(figure, tmp_path / "a", ("png", "svg", "pdf"))
    assert {path: path.read_bytes() for path in paths} == first
    image = matplotlib.image.imread(paths[0])
    assert image.shape[:2] == (130, 260)
    assert b"<dc:date>" not in first[paths[1]] and b"CreationDate" not in first[paths[2]]


def test_columns_fill_the_width_that_there_is() -> None:
    """About thirteen characters fit in an inch, beside a line of half an inch."""
    cases = (6.0, 10, 4), (6.0, 20, 2), (3.0, 10, 2), (12.0, 1, 6), (4.0, 60, 1)
    for width, length, columns in cases:
        figure = Figure(figsize=(width, 3.0))
        style.legend_below(figure, [(Line2D([], []), "a" * length)] * 8)
        assert figure.legends[0]._ncols == columns
        assert figure.get_figheight() == pytest.approx(3 + 0.19 * np.ceil(8 / columns))


def test_the_papers_sensors_come_first() -> None:
    assert style.sensor_order(["b", "partial", "a", "full", "b"]) == ["full", "partial", "a", "b"]


def test_a_picture_of_a_page_keeps_its_text_and_shares_no_counted_ids() -> None:
    with style.applied():
        figure = Figure()
        figure.add_subplot().set_title("a < b")
        text = style.svg_text(figure)
    assert text.startswith("<svg") and "a &lt; b" in text
    assert 'id="axes_1"' not in text and "dc:date" not in text
