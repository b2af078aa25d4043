"""The highD data set: German motorways from above, ``NN_tracks.csv`` with ``NN_recordingMeta.csv``.

Positions are upper left corners of boxes in an image whose y axis points down. Lanes are between
the markings in ``NN_recordingMeta.csv``. Upper lanes run against the x axis.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np

from olne_bench.envs.tracks.road import RoadLane, read_lanes
from olne_bench.envs.tracks.table import (
    Tracks,
    direction,
    no_parts,
    of_columns,
    plain_float,
    read_frames,
)
from olne_bench.games.model.lanes import StraightLane

DESCRIPTION = "highD: NN_tracks.csv, with NN_recordingMeta.csv beside it; lanes from its markings"
_NUMBERS = ("x", "y", "width", "height", "xVelocity", "yVelocity")
_MARKINGS = {"upper": "upperLaneMarkings", "lower": "lowerLaneMarkings"}
_BEYOND = 50.0  # [m] by which lanes extend beyond the tracks at both ends


def read(path: Path, part: str | None) -> Tracks:
    """Read a recording; see ``track_formats``."""
    no_parts(part, "a file of highD is one recording")
    rows, meta, _ = read_frames(path, "id", _NUMBERS, tuple(_MARKINGS.values()))
    table = of_columns(
        time=rows["time"],
        player=rows["player"],
        x=rows["x"] + rows["width"] / 2,  # width is along x, hence the car's length
        y=rows["y"] + rows["height"] / 2,
        heading=direction(rows["xVelocity"], rows["yVelocity"]),
        speed=np.hypot(rows["xVelocity"], rows["yVelocity"]),
        length=rows["width"],
        **{"class": rows["class"]},
    )
    low, high = float(table["x"].min()) - _BEYOND, float(table["x"].max()) + _BEYOND
    between = {
        f"{side}_{number}": pair
        for side, name in _MARKINGS.items()
        if name in meta
        for number, pair in enumerate(pairwise(str(meta[name].iloc[0]).split(";")), 1)
    }
    road = read_lanes(
        dict.fromkeys(between, ()), lambda name: _lane(name, between[name], low, high)
    )
    return Tracks(table, road)


def _lane(name: str, markings: tuple[str, str], low: float, high: float) -> RoadLane:
    """The lane between two markings, which are texts of y [m]."""
    first, second = map(plain_float, markings)
    start, way = (high, -1.0) if name.startswith("upper") else (low, 1.0)
    line = StraightLane((start, (first + second) / 2), (way, 0.0), high - low)
    return RoadLane((line,), abs(second - first))
