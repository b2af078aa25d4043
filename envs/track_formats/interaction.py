"""The INTERACTION data set: ``vehicle_tracks_NNN.csv``, or a file with many cases.

Times are in milliseconds, positions are centres, headings are in radians.
"""

from pathlib import Path

import numpy as np

from olne_bench.envs.tracks.table import (
    Tracks,
    choose_part,
    direction,
    numbers,
    of_columns,
    player_names,
    read_columns,
    with_columns,
)

DESCRIPTION = "INTERACTION: vehicle_tracks_NNN.csv; --part chooses a case_id where there are some"
_NUMBERS = ("timestamp_ms", "x", "y", "vx", "vy")
_OPTIONAL = ("psi_rad", "length")


def read(path: Path, part: str | None) -> Tracks:
    """Read one case; see ``track_formats``."""
    rows = read_columns(path, ("track_id", *_NUMBERS), (*_OPTIONAL, "agent_type", "case_id"))
    rows = choose_part(path, rows, "case_id", part)
    rows = numbers(path, rows, [name for name in (*_NUMBERS, *_OPTIONAL) if name in rows])
    rows = with_columns(rows, (*_OPTIONAL, "agent_type"))
    return Tracks(
        of_columns(
            time=rows["timestamp_ms"] / 1000,
            player=player_names(rows["track_id"]),
            x=rows["x"],
            y=rows["y"],
            heading=rows["psi_rad"].fillna(direction(rows["vx"], rows["vy"])),
            speed=np.hypot(rows["vx"], rows["vy"]),
            length=rows["length"],
            **{"class": rows["agent_type"]},
        )
    )
