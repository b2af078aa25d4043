"""The result of reading a track file: rows of motion, and the road if the file has one."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from olne_bench.envs.tracks.road import Road
from olne_bench.errors import UserError, bad_input

#: Columns of every table of tracks: s, name, m, m, rad, m/s.
COLUMNS = ("time", "player", "x", "y", "heading", "speed")
#: Component of the state that a column holds.
STATE_NAMES = {"x": "px", "y": "py", "heading": "heading", "speed": "speed"}
SLOWEST = 0.1  # [m/s]; slower velocities have no reliable direction
_SHOWN = 8  # names in a message


@dataclass(frozen=True)
class Tracks:
    """Rows of motion in metres, seconds and radians; positions are those of the cars' centres.

    Attributes:
        table: one row per player and time, with ``COLUMNS``; NaN where unknown.
        road: lanes, if the format has a map.
        notes: what the reader had to assume or leave out, one line each.
        origin: UTM east and north [m] of position (0, 0), if the file has them.
    """

    table: pd.DataFrame
    road: Road | None = None
    notes: tuple[str, ...] = ()
    origin: tuple[float, float] | None = None


def read_columns(
    path: Path, needed: Sequence[str], optional: Sequence[str] = (), **settings: object
) -> pd.DataFrame:
    """Read columns of a data set's CSV file; the case of their names does not matter.

    Raises:
        UserError: if the file is missing, is not CSV or lacks a column.
    """
    if not path.is_file():
        raise UserError(f"no tracks file {str(path)!r}")
    with bad_input(f"{path} is not a CSV file", OSError):
        frame = pd.read_csv(path, low_memory=False, **settings)  # type: ignore[call-overload]
    there = {str(name).strip().lower(): name for name in frame.columns}
    absent = [name for name in needed if name.lower() not in there]
    if absent:
        raise UserError(
            f"{path}: missing column{'s'[: len(absent) > 1]} {', '.join(absent)}; "
            f"it has: {', '.join(map(str, frame.columns))}"
        )
    names = {there[name.lower()]: name for name in (*needed, *optional) if name.lower() in there}
    return frame[list(names)].rename(columns=names)


def numbers(path: Path, frame: pd.DataFrame, names: Sequence[str]) -> pd.DataFrame:
    """The table with the named columns as numbers.

    Raises:
        UserError: with a message that names the row and the value that is not a number.
    """
    frame = frame.copy()
    for name in names:
        values = pd.to_numeric(frame[name], errors="coerce").astype(float)
        wrong = (frame[name].notna() & ~np.isfinite(values)).to_numpy()
        if wrong.any():
            row = int(wrong.argmax())
            raise UserError(
                f"{path}, row {row + 1}: {name} is {str(frame[name].iloc[row])!r}, "
                "expected a finite number"
            )
        frame[name] = values
    return frame


def companion(path: Path, suffix: str, purpose: str) -> Path:
    """The file ``NN_<suffix>.csv`` beside ``NN_tracks.csv``.

    Raises:
        UserError: if it does not exist.
    """
    stem = path.stem.removesuffix("_tracks")
    beside = path.with_name(f"{stem}_{suffix}.csv")
    if not beside.is_file():
        raise UserError(f"{path}: its {purpose} is in {beside.name!r}, which is not beside it")
    return beside


def frame_rate(meta: pd.DataFrame, path: Path) -> float:
    """Frames per second from a recording's metadata.

    Raises:
        UserError: unless it is positive.
    """
    rate = float(numbers(path, meta, ["frameRate"])["frameRate"].iloc[0])
    if not rate > 0:
        raise UserError(f"{path}: frameRate is {rate:g}, expected a positive number")
    return rate


def choose_part(path: Path, frame: pd.DataFrame, column: str, part: str | None) -> pd.DataFrame:
    """The rows of one part of a file in which player names repeat.

    Raises:
        UserError: if an unknown part is chosen, or none although there are several.
    """
    if column not in frame:
        if part is not None:
            raise UserError(f"--part {part!r}: {path} has no column {column}")
        return frame
    names = frame[column].map(_text)
    parts = list(names.unique())
    if part is None and len(parts) > 1:
        raise UserError(f"{path} holds {listed(parts)} in {column}; choose one with --part")
    if part is not None and part not in parts:
        raise UserError(f"--part {part!r}: {column} of {path} holds {listed(parts)}")
    return frame if part is None else frame[names == part]


def listed(names: Sequence[str]) -> str:
    """The first few names as text, for messages."""
    more = len(names) - _SHOWN
    return ", ".join(names[:_SHOWN]) + (f" and {more} more" if more > 0 else "")


def player_names(ids: pd.Series) -> pd.Series:
    """Names of players from a column of numbers or texts."""
    return ids.map(_text)


def direction(vx: pd.Series, vy: pd.Series) -> np.ndarray:
    """Headings (R,) [rad] of velocities; NaN where a car hardly moves."""
    moving = np.hypot(vx, vy) > SLOWEST
    return np.where(moving, np.arctan2(vy, vx), np.nan)


def _text(value: object) -> str:
    if value is None or value != value:
        return ""
    if isinstance(value, float) and value.is_integer():
        return str(int(value))
    return str(value).strip()
