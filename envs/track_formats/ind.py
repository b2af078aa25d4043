"""The data sets inD, rounD, exiD and uniD: ``NN_tracks.csv`` with ``NN_recordingMeta.csv``.

Positions are centres of boxes. Headings are in degrees from the x axis towards the y axis.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from olne_bench.envs.tracks.table import Tracks, no_parts, numbers, of_columns, read_frames

DESCRIPTION = "inD, rounD, exiD, uniD: NN_tracks.csv, with NN_recordingMeta.csv beside it"
_NUMBERS = ("xCenter", "yCenter", "heading", "length", "xVelocity", "yVelocity")
_ORIGIN = ("xUtmOrigin", "yUtmOrigin")


def read(path: Path, part: str | None) -> Tracks:
    """Read a recording; see ``track_formats``."""
    no_parts(part, "a file of inD is one recording")
    rows, meta, meta_path = read_frames(path, "trackId", _NUMBERS, _ORIGIN)
    table = of_columns(
        time=rows["time"],
        player=rows["player"],
        x=rows["xCenter"],
        y=rows["yCenter"],
        heading=np.deg2rad(rows["heading"]),
        speed=np.hypot(rows["xVelocity"], rows["yVelocity"]),
        length=rows["length"],
        # Without classes: a pedestrian or cyclist has no size.
        **{"class": rows["class"].mask((rows["class"] == "") & (rows["length"] == 0), "person")},
    )
    return Tracks(table, origin=_origin(meta_path, meta))


def _origin(path: Path, meta: pd.DataFrame) -> tuple[float, float] | None:
    """UTM east and north [m] of the recording's origin; None if its metadata do not have them."""
    if not set(_ORIGIN) <= set(meta.columns):
        return None
    east, north = numbers(path, meta, _ORIGIN)[list(_ORIGIN)].iloc[0]
    return (float(east), float(north)) if np.isfinite([east, north]).all() else None
