"""Frames of tracks: mirrored, then turned, then shifted."""

import numpy as np
import pandas as pd
import pytest

from olne_bench.envs.tracks.grid import Frame

HEADING = 0.4
TABLE = pd.DataFrame(
    {
        "x": 2.0 + np.cos(HEADING) * np.arange(4),
        "y": 5.0 + np.sin(HEADING) * np.arange(4),
        "heading": HEADING,
        "speed": 1.0,
    }
)
FRAMES = [
    Frame(flip_y=flip, rotate=turn, shift=shift)
    for flip in (False, True)
    for turn in (0.0, 0.7, -2.0)
    for shift in ((0.0, 0.0), (30.0, -4.0))
]


@pytest.mark.parametrize("frame", FRAMES, ids=str)
def test_headings_point_along_the_motion_in_every_frame(frame: Frame) -> None:
    moved = frame.apply(TABLE)
    along = np.diff(moved[["x", "y"]], axis=0)
    heading = moved["heading"].to_numpy()[:3]
    np.testing.assert_allclose(along, np.column_stack([np.cos(heading), np.sin(heading)]))
    pd.testing.assert_series_equal(moved["speed"], TABLE["speed"])


def test_a_frame_is_mirrored_then_turned_then_shifted() -> None:
    mirrored = Frame(flip_y=True).apply(TABLE)
    np.testing.assert_array_equal(mirrored["x"], TABLE["x"])
    np.testing.assert_array_equal(mirrored["y"], -TABLE["y"])
    turned = Frame(rotate=0.7).apply(mirrored)
    np.testing.assert_allclose(np.hypot(turned["x"], turned["y"]), np.hypot(TABLE["x"], TABLE["y"]))
    shifted = Frame(shift=(30.0, -4.0)).apply(turned)
    np.testing.assert_allclose(shifted[["x", "y"]] - turned[["x", "y"]], np.tile([30, -4], (4, 1)))
    pd.testing.assert_frame_equal(
        Frame(flip_y=True, rotate=0.7, shift=(30.0, -4.0)).apply(TABLE), shifted
    )


def test_the_same_frame_changes_nothing() -> None:
    assert Frame().apply(TABLE) is TABLE
