"""Positions in the world as pixels."""

import numpy as np
import pytest

from olne_bench.envs.worlds.rendering import (
    HEADER,
    MARGIN,
    MAX_HEIGHT,
    MAX_WIDTH,
    SHARPNESS,
    Camera,
)

WIDE = np.array([[0.0, 0.0], [40.0, 10.0]])


def test_a_view_has_a_margin_around_what_is_expected() -> None:
    view = Camera(WIDE)
    np.testing.assert_allclose(view.low[0], -view.high[0] + 40)
    margin = MARGIN * 40 * (1 + 2 * MARGIN)
    np.testing.assert_allclose([view.low[0], view.low[1]], [-margin, -margin])
    np.testing.assert_allclose(view.high, [40 + margin, 10 + margin])


def test_a_line_is_seen_in_a_box_no_longer_than_four_to_one() -> None:
    view = Camera(np.array([[0.0, 5.0], [40.0, 5.0]]))
    width, height = view.high - view.low
    assert height == pytest.approx(
        width * (1 + 2 * MARGIN) / (1 + 2 * MARGIN * (1 + 2 * MARGIN)) / 4
    )
    np.testing.assert_allclose((view.low + view.high) / 2, [20, 5])


def test_a_single_point_has_a_view() -> None:
    view = Camera(np.array([[3.0, 3.0]]))
    assert (view.high > view.low).all()
    np.testing.assert_allclose((view.high - view.low)[0], 1e-3 * 0.24 * (1 + 2 * MARGIN), rtol=0.05)


@pytest.mark.parametrize("tall", [False, True])
def test_frames_are_as_large_as_they_may_be(tall: bool) -> None:
    view = Camera(WIDE[:, ::-1] if tall else WIDE)
    width, height = view.frame_size
    assert width == MAX_WIDTH or height - HEADER == MAX_HEIGHT
    assert width <= MAX_WIDTH
    assert height - HEADER <= MAX_HEIGHT
    assert width > height


def test_corners_come_to_the_edges_and_the_middle_below_the_header() -> None:
    view = Camera(WIDE)
    width, height = (SHARPNESS * n for n in view.frame_size)
    middle = view.pixels((view.low + view.high) / 2)
    np.testing.assert_allclose(middle, [width / 2, (SHARPNESS * HEADER + height) / 2])
    upper_left = view.pixels([view.low[0], view.high[1]])
    np.testing.assert_allclose(upper_left, [0, SHARPNESS * HEADER], atol=SHARPNESS)
    lower_right = view.pixels([view.high[0], view.low[1]])
    np.testing.assert_allclose(lower_right, [width, height], atol=SHARPNESS)


def test_a_tall_view_is_turned_so_that_y_points_right_and_x_down() -> None:
    view = Camera(WIDE[:, ::-1])
    origin = np.array(view.pixels((view.low + view.high) / 2))
    along_y = np.array(view.pixels((view.low + view.high) / 2 + [0, 1])) - origin
    along_x = np.array(view.pixels((view.low + view.high) / 2 + [1, 0])) - origin
    np.testing.assert_allclose(along_y, [view.scale, 0], atol=1e-9)
    np.testing.assert_allclose(along_x, [0, view.scale], atol=1e-9)


def test_a_view_is_widened_where_it_must_be_and_frames_stay_as_large() -> None:
    view = Camera(WIDE)
    low, high, size, scale = view.low, view.high, view.frame_size, view.scale
    view.widen(np.array([[20.0, 5.0], high, low]))
    assert view.low is low
    assert view.high is high
    view.widen(np.array([[high[0] + 30, 5.0], [20.0, 5.0]]))
    assert view.frame_size == size
    assert view.scale < scale
    assert view.high[0] > high[0] + 30
    assert (view.low < low).all()
    # Widened only slightly: the margin was there before.
    assert view.high[0] < high[0] + 30 + 0.05 * (view.high - view.low)[0]
