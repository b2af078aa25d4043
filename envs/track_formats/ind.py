"""The data sets inD, rounD, exiD and uniD: ``NN_tracks.csv`` with ``NN_recordingMeta.csv``.

Positions are centres of boxes. Headings are in degrees from the x axis towards the y axis.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from olne_bench.envs.tracks.table import (
    COLUMNS,
    Tracks,
    companion,
    frame_rate,
    numbers,
    player_names,
    read_columns,
)
from olne_bench.errors import UserError

DESCRIPTION = "inD, rounD, exiD, uniD: NN_tracks.csv, with NN_recordingMeta.csv beside it"
_NUMBERS = ("frame", "xCenter", "yCenter", "heading", "xVelocity", "yVelocity")
_ORIGIN = ("xUtmOrigin", "yUtmOrigin")


def read(path: Path, part: str | None) -> Tracks:
    """Read a recording; see ``track_formats``."""
    if part is not None:
        raise UserError(f"--part {part!r}: a file of inD is one recording")
    rows = numbers(path, read_columns(path, ("trackId", *_NUMBERS)), _NUMBERS)
    meta_path = companion(path, "recordingMeta", "frame rate")
    meta = read_columns(meta_path, ("frameRate",), _ORIGIN)
    table = pd.DataFrame(
        {
            "time": rows["frame"] / frame_rate(meta, meta_path),
            "player": player_names(rows["trackId"]),
            "x": rows["xCenter"],
            "y": rows["yCenter"],
            "heading": np.deg2rad(rows["heading"]),
            "speed": np.hypot(rows["xVelocity"], rows["yVelocity"]),
        }
    )
    return Tracks(table[list(COLUMNS)], origin=_origin(meta_path, meta))


def _origin(path: Path, meta: pd.DataFrame) -> tuple[float, float] | None:
    """UTM east and north [m] of the recording's origin; None if its metadata do not have them."""
    if not set(_ORIGIN) <= set(meta.columns):
        return None
    east, north = numbers(path, meta, _ORIGIN)[list(_ORIGIN)].iloc[0]
    return (float(east), float(north)) if np.isfinite([east, north]).all() else None
