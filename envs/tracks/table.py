"""The result of reading a track file: rows of motion, and the road if the file has one."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from olne_bench.envs.tracks.checks import LONGEST_STEP, SHORTEST_STEP
from olne_bench.envs.tracks.road import Road
from olne_bench.envs.tracks.text import listed, read_sheet
from olne_bench.errors import UserError

#: Columns of every table of tracks: s, name, m, m, rad, m/s, m, what it is.
COLUMNS = ("time", "player", "x", "y", "heading", "speed", "length", "class")
#: Component of the state that a column holds.
STATE_NAMES = {"x": "px", "y": "py", "heading": "heading", "speed": "speed"}
SLOWEST = 0.1  # [m/s]; slower velocities have no reliable direction
_MISSING = {"", "nan", "na", "n/a", "null", "none"}
_SHOWN = 60  # characters of a cell in a message


@dataclass(frozen=True)
class Tracks:
    """Rows of motion in metres, seconds and radians; positions are those of the cars' centres."""

    table: pd.DataFrame  # one row per player and time, with ``COLUMNS``; NaN where unknown
    road: Road | None = None  # lanes, if the format has a map
    notes: tuple[str, ...] = ()  # what the reader had to assume or leave out, one line each
    #: UTM east and north [m] of position (0, 0), if the file has them.
    origin: tuple[float, float] | None = None


def read_columns(
    path: Path, needed: Sequence[str], optional: Sequence[str] = (), usual: Sequence[str] = ()
) -> pd.DataFrame:
    """Read columns of a data set's table; ``usual`` are the names in a file without any."""
    return read_sheet(path, usual).columns(needed, optional)


def with_columns(frame: pd.DataFrame, names: Sequence[str]) -> pd.DataFrame:
    """The table with the named columns, NaN where it lacks one."""
    return frame.reindex(columns=[*frame, *(name for name in names if name not in frame)])


def plain_float(text: str) -> float:
    """The number in a file; Python would also take ``1_0`` and digits of other scripts."""
    if not text.isascii() or "_" in text:
        raise ValueError(f"could not convert string to float: {text[:_SHOWN]!r}")
    return float(text)


def numbers(
    path: Path, frame: pd.DataFrame, names: Sequence[str], place: str = "row"
) -> pd.DataFrame:
    """Named columns as numbers, NaN where empty; UserError names the place and what is none."""
    frame = frame.copy()
    for name in names:
        known = frame[name]
        if pd.api.types.is_string_dtype(known):
            known = known.mask(known.str.strip().str.lower().isin(_MISSING))
        values = pd.to_numeric(known, errors="coerce").astype(float)
        if pd.api.types.is_bool_dtype(known):
            values[:] = np.nan  # pandas reads True as 1
        wrong = known.notna() & ~np.isfinite(values)
        if wrong.any():
            at = int(wrong.index.to_numpy()[wrong.to_numpy().argmax()])
            raise UserError(
                f"{path}, {place} {at + 1}: {name} is {str(frame[name][at])[:_SHOWN]!r}, "
                "expected a finite number"
            )
        frame[name] = values
    return frame


def no_parts(part: str | None, whole: str = "files of this format have no parts") -> None:
    """Refuse to choose a part of a file that has none."""
    if part is not None:
        raise UserError(f"--part {part!r}: {whole}")


def of_columns(**columns: object) -> pd.DataFrame:
    """A table of tracks from those of its ``COLUMNS`` that are known."""
    return pd.DataFrame(columns, columns=list(COLUMNS))


def read_frames(
    path: Path, player: str, names: Sequence[str], more: Sequence[str] = ()
) -> tuple[pd.DataFrame, pd.DataFrame, Path]:
    """The rows of ``NN_tracks.csv``, and the metadata in ``NN_recordingMeta.csv`` and their path.

    ``player`` is the column of the players' names, ``names`` those of numbers; ``time`` [s] comes
    from ``frame`` and the frame rate, ``class`` from ``NN_tracksMeta.csv``, if it is there.
    ``more`` columns of the metadata are read if they are there.
    """
    rows = numbers(path, read_columns(path, (player, "frame", *names)), ("frame", *names))
    meta_path = companion(path, "recordingMeta")
    if meta_path is None:
        beside = f"{_stem(path)}_recordingMeta.csv"
        raise UserError(f"{path}: its frame rate is in {beside!r}, which is not beside it")
    meta = read_columns(meta_path, ("frameRate",), more)
    rows["time"] = rows["frame"] / frame_rate(meta, meta_path)
    rows["player"], rows["class"] = player_names(rows[player]), ""
    classes = companion(path, "tracksMeta")
    if classes is not None:
        told = read_columns(classes, (player, "class"))
        known = dict(zip(player_names(told[player]), told["class"], strict=True))
        rows["class"] = rows["player"].map(known)
    return rows, meta, meta_path


def companion(path: Path, suffix: str) -> Path | None:
    """The file ``NN_<suffix>.csv`` beside ``NN_tracks.csv``, packed or not; None if none is."""
    names = [f"{_stem(path)}_{suffix}.csv{packed}" for packed in ("", ".gz", ".zip")]
    return next((path.with_name(name) for name in names if path.with_name(name).is_file()), None)


def _stem(path: Path) -> str:
    return re.sub(r"(_tracks)?(\.csv)?(\.gz|\.zip)?$", "", path.name, flags=re.IGNORECASE)


def frame_rate(meta: pd.DataFrame, path: Path) -> float:
    """Frames per second from a recording's metadata."""
    rate = float(numbers(path, meta, ["frameRate"])["frameRate"].iloc[0])
    least, most = 1 / LONGEST_STEP, 1 / SHORTEST_STEP
    if not least <= rate <= most:
        raise UserError(f"{path}: frameRate is {rate:g}, expected {least:g} to {most:g} per second")
    return rate


def choose_part(path: Path, frame: pd.DataFrame, column: str, part: str | None) -> pd.DataFrame:
    """The rows of one part of a file in which player names repeat."""
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


def player_names(ids: pd.Series) -> pd.Series:
    """Names of players from a column of numbers or texts."""
    return ids.map(_text)


def direction(vx: pd.Series, vy: pd.Series) -> pd.Series:
    """Headings [rad] of velocities; NaN where a car hardly moves."""
    angles = pd.Series(np.arctan2(vy, vx), vx.index)
    return angles.where(np.hypot(vx, vy) > SLOWEST)


def _text(value: object) -> str:
    if value is None or value != value:
        return ""
    if isinstance(value, float) and value.is_integer():
        return str(int(value))
    return str(value).strip()
