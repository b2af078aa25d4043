"""The NGSIM data set: US motorways and arterials, in feet and tenths of a second.

Local_Y runs along the road and Local_X across it, so they become x and y; both are those of the
centre of the front. There are no headings. A lane is where the cars with its Lane_ID drive.
Files are CSV with a header, or the original text files without one.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from olne_bench.envs.tracks.fronts import along_road, centred, travel
from olne_bench.envs.tracks.road import Road, RoadLane
from olne_bench.envs.tracks.table import (
    Tracks,
    choose_part,
    numbers,
    of_columns,
    player_names,
    read_columns,
    with_columns,
)
from olne_bench.games.model.lanes import StraightLane

DESCRIPTION = "NGSIM: trajectories in feet, CSV or text; --part chooses a Location"
FOOT = 0.3048  # [m]
FRAME = 0.1  # [s]
_NUMBERS = ("Frame_ID", "Local_X", "Local_Y", "v_Length", "v_Vel")
_OPTIONAL = ("Lane_ID", "Global_Time", "v_Width", "v_Class", "Direction")
#: Columns of the original text files.
_TEXT_COLUMNS = (
    *("Vehicle_ID", "Frame_ID", "Total_Frames", "Global_Time", "Local_X", "Local_Y"),
    *("Global_X", "Global_Y", "v_Length", "v_Width", "v_Class", "v_Vel", "v_Acc", "Lane_ID"),
    *("Preceding", "Following", "Space_Headway", "Time_Headway"),
)
_BEYOND = 50.0  # [m] by which lanes extend beyond the tracks at both ends
_WIDTH = 12 * FOOT  # [m], lane of a US motorway
_PERIOD = 1.0  # [s] by which clocks of two periods of recording differ at least
_CLASSES = {1: "motorcycle", 2: "car", 3: "truck"}  # of v_Class
_MOTORCYCLE = 1
_LONGER, _WIDER = 8.0, 3.5  # medians above these are feet, not metres
#: Directions of travel of Direction: east, north, west, south; x points north, y east.
_COMPASS = {1: np.pi / 2, 2: 0.0, 3: -np.pi / 2, 4: np.pi}
_ON_ROAD = np.cos(np.deg2rad(30))  # cosine of the largest angle between a lane and its cars


def read(path: Path, part: str | None) -> Tracks:
    """Read one location; see ``track_formats``."""
    rows = read_columns(
        path, ("Vehicle_ID", *_NUMBERS), (*_OPTIONAL, "Location"), usual=_TEXT_COLUMNS
    )
    rows = choose_part(path, rows, "Location", part)
    rows = numbers(path, rows, [name for name in (*_NUMBERS, *_OPTIONAL) if name in rows])
    rows = with_columns(rows, _OPTIONAL)
    unit, notes = _unit(rows)
    fronts = of_columns(
        time=_times(rows),
        player=player_names(rows["Vehicle_ID"]),
        x=unit * rows["Local_Y"],
        y=unit * rows["Local_X"],
        speed=unit * rows["v_Vel"],
        length=unit * rows["v_Length"],
        **{"class": rows["v_Class"].map(_CLASSES)},
    )
    ways = along_road(travel(fronts).fillna(rows["Direction"].map(_COMPASS)), fronts["player"])
    table = centred(fronts, ways, fronts["length"] / 2)
    lanes = _lanes(table, rows["Lane_ID"], ways)
    if not lanes:
        return Tracks(table, notes=notes)
    note = "lanes are at the median Local_X of the cars with their Lane_ID"
    return Tracks(table, Road(lanes), (*notes, note))


def _unit(rows: pd.DataFrame) -> tuple[float, tuple[str, ...]]:
    """The unit of lengths [m], by the size of cars, and a note where it is not a foot."""
    cars = rows[rows["v_Class"] != _MOTORCYCLE]
    length, width = (cars[name].replace(0, np.nan).median() for name in ("v_Length", "v_Width"))
    if not (length < _LONGER or width < _WIDER):
        return FOOT, ()
    return 1.0, (
        f"v_Length has a median of {length:.3g}: the file is taken to be in metres, not in feet",
    )


def _times(rows: pd.DataFrame) -> pd.Series:
    """Times [s] from frames; those of a later period, whose frames begin again, by Global_Time."""
    times = FRAME * rows["Frame_ID"]
    begins = (rows["Global_Time"] / 1000 - times).sort_values()
    period = (begins.diff() > _PERIOD).cumsum().reindex(rows.index)
    by_period = begins.groupby(period)
    if begins.isna().any() or (by_period.max() - by_period.min() > _PERIOD).any():
        return times  # Global_Time is not a clock, for example after a spreadsheet has rounded it
    later = period.map(by_period.median() - by_period.median().iloc[0])
    return times + FRAME * (later / FRAME).round()


def _lanes(table: pd.DataFrame, lanes: pd.Series, ways: pd.Series) -> dict[str, RoadLane]:
    """A lane for each Lane_ID and direction, as long as all tracks."""
    ahead = np.cos(ways.fillna(0.0))
    known = (lanes >= 1) & (np.abs(ahead) >= _ON_ROAD) & table["y"].notna()
    if not known.any():
        return {}
    low, high = float(table["x"].min()) - _BEYOND, float(table["x"].max()) + _BEYOND
    result: dict[str, RoadLane] = {}
    beside = table["y"][known].groupby([player_names(lanes[known]), ahead[known] < 0]).median()
    for (name, against), y in beside.items():
        start, way = (high, -1.0) if against else (low, 1.0)
        lane = RoadLane((StraightLane((start, float(y)), (way, 0.0), high - low),), _WIDTH)
        result[f"lane_{name}" + "_back" * (f"lane_{name}" in result)] = lane
    return result
