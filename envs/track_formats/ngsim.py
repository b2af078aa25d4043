"""The NGSIM data set: US motorways, in feet and tenths of a second.

Local_Y runs along the road and Local_X across it, so they become x and y; both are those of the
centre of the front. There are no headings. A lane is where the cars with its Lane_ID drive.
Files are CSV with a header, or the original text files without one.
"""

from pathlib import Path

import numpy as np

from olne_bench.envs.tracks.road import Road, RoadLane
from olne_bench.envs.tracks.table import (
    Tracks,
    choose_part,
    numbers,
    of_columns,
    player_names,
    read_columns,
)
from olne_bench.games.model.lanes import StraightLane

DESCRIPTION = "NGSIM: trajectories in feet, CSV or text; --part chooses a Location"
FOOT = 0.3048  # [m]
FRAME = 0.1  # [s]
_NUMBERS = ("Frame_ID", "Local_X", "Local_Y", "v_Length", "v_Vel")
#: Columns of the original text files.
_TEXT_COLUMNS = (
    *("Vehicle_ID", "Frame_ID", "Total_Frames", "Global_Time", "Local_X", "Local_Y"),
    *("Global_X", "Global_Y", "v_Length", "v_Width", "v_Class", "v_Vel", "v_Acc", "Lane_ID"),
    *("Preceding", "Following", "Space_Headway", "Time_Headway"),
)
_BEYOND = 50.0  # [m] by which lanes extend beyond the tracks at both ends
_WIDTH = 12 * FOOT  # [m], lane of a US motorway


def read(path: Path, part: str | None) -> Tracks:
    """Read one location; see ``track_formats``."""
    text = {"sep": r"\s+", "names": _TEXT_COLUMNS} if path.suffix.lower() == ".txt" else {}
    rows = read_columns(path, ("Vehicle_ID", *_NUMBERS), ("Lane_ID", "Location"), **text)
    rows = numbers(path, choose_part(path, rows, "Location", part), _NUMBERS)
    table = of_columns(
        time=FRAME * rows["Frame_ID"],
        player=player_names(rows["Vehicle_ID"]),
        x=FOOT * (rows["Local_Y"] - rows["v_Length"] / 2),
        y=FOOT * rows["Local_X"],
        heading=np.nan,
        speed=FOOT * rows["v_Vel"],
    )
    if "Lane_ID" not in rows or table.empty:
        return Tracks(table)
    low, high = float(table["x"].min()) - _BEYOND, float(table["x"].max()) + _BEYOND
    lanes = {
        f"lane_{name}": RoadLane((StraightLane((low, float(y)), (1.0, 0.0), high - low),), _WIDTH)
        for name, y in table["y"].groupby(player_names(rows["Lane_ID"])).median().items()
    }
    note = "lanes are at the median Local_X of the cars with their Lane_ID"
    return Tracks(table, Road(lanes), (note,))
