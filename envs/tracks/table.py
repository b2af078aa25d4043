"""The result of reading a track file: rows of motion, and the road if the file has one."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from olne_bench.envs.tracks.checks import LONGEST_STEP, SHORTEST_STEP
from olne_bench.envs.tracks.road import Road
from olne_bench.errors import UserError, bad_input
from olne_bench.files import check_input

#: Columns of every table of tracks: s, name, m, m, rad, m/s.
COLUMNS = ("time", "player", "x", "y", "heading", "speed")
#: Component of the state that a column holds.
STATE_NAMES = {"x": "px", "y": "py", "heading": "heading", "speed": "speed"}
SLOWEST = 0.1  # [m/s]; slower velocities have no reliable direction
#: Largest file of tracks [bytes]; those of the data sets are smaller.
MOST_BYTES = 2**31
_LONGEST_TITLES = 2**16  # [bytes] of the line of column names
_SHOWN, _SHOWN_NAME = 8, 60  # names in a message, and characters of each


@dataclass(frozen=True)
class Tracks:
    """Rows of motion in metres, seconds and radians; positions are those of the cars' centres."""

    table: pd.DataFrame  # one row per player and time, with ``COLUMNS``; NaN where unknown
    road: Road | None = None  # lanes, if the format has a map
    notes: tuple[str, ...] = ()  # what the reader had to assume or leave out, one line each
    #: UTM east and north [m] of position (0, 0), if the file has them.
    origin: tuple[float, float] | None = None


def read_columns(
    path: Path, needed: Sequence[str], optional: Sequence[str] = (), **settings: object
) -> pd.DataFrame:
    """Read columns of a data set's CSV file; the case of their names does not matter."""
    titles = list(settings.get("names") or read_titles(path))  # type: ignore[call-overload]
    there = [str(title).lower() for title in titles]
    check_titles(path, titles, [name for name in needed if name.lower() not in there])
    found = [name for name in (*needed, *optional) if name.lower() in there]
    twice = [name for name in found if there.count(name.lower()) > 1]
    if twice:
        raise UserError(f"{path}: column {twice[0]!r} appears twice")
    with bad_input(f"{path} is not a CSV file", OSError):
        frame = pd.read_csv(path, low_memory=False, **settings)  # type: ignore[call-overload]
    if not isinstance(frame.index, pd.RangeIndex):  # pandas would shift the columns by one
        raise UserError(f"{path}: its rows have more cells than the {len(titles)} column names")
    if frame.empty:
        raise UserError(f"{path} has column names, but no rows")
    named: pd.DataFrame = frame.set_axis(there, axis=1)[[name.lower() for name in found]]
    return named.set_axis(found, axis=1)


def read_titles(path: Path) -> list[str]:
    """The column names of a CSV file, as it has them."""
    check_input("tracks file", path, MOST_BYTES)
    with path.open("rb") as file:
        if len(file.readline(_LONGEST_TITLES + 1)) > _LONGEST_TITLES:
            raise UserError(
                f"{path} is not a CSV file: its first line has more than {_LONGEST_TITLES} bytes"
            )
    with bad_input(f"{path} is not a CSV file", OSError):
        first = pd.read_csv(
            path, dtype=str, header=None, nrows=1, keep_default_na=False, encoding="utf-8-sig"
        )
    return [str(name).strip() for name in first.iloc[0]]


def check_titles(path: Path, titles: Sequence[str], absent: Sequence[str]) -> None:
    """Refuse a table that lacks columns."""
    if absent:
        raise UserError(
            f"{path}: missing column{'s'[: len(absent) > 1]} {', '.join(absent)}; "
            f"it has: {listed(titles)}"
        )


def plain_float(text: str) -> float:
    """The number in a file; Python would also take ``1_0`` and digits of other scripts."""
    if not text.isascii() or "_" in text:
        raise ValueError(f"could not convert string to float: {text[:_SHOWN_NAME]!r}")
    return float(text)


def numbers(
    path: Path, frame: pd.DataFrame, names: Sequence[str], place: str = "row"
) -> pd.DataFrame:
    """The table with the named columns as numbers, NaN where a cell is empty.

    Messages of UserError name the place, by its index, and what is not a number.
    """
    frame = frame.copy()
    for name in names:
        values = pd.to_numeric(frame[name], errors="coerce").astype(float)
        if pd.api.types.is_bool_dtype(frame[name]):
            values[:] = np.nan  # pandas reads True as 1
        wrong = frame[name].notna() & ~np.isfinite(values)
        if wrong.any():
            at = int(wrong.index.to_numpy()[wrong.to_numpy().argmax()])
            raise UserError(
                f"{path}, {place} {at + 1}: {name} is {str(frame[name][at])[:_SHOWN_NAME]!r}, "
                "expected a finite number"
            )
        frame[name] = values
    return frame


def no_parts(part: str | None, whole: str = "files of this format have no parts") -> None:
    """Refuse to choose a part of a file that has none."""
    if part is not None:
        raise UserError(f"--part {part!r}: {whole}")


def of_columns(**columns: object) -> pd.DataFrame:
    """A table of tracks from its ``COLUMNS``."""
    return pd.DataFrame(columns, columns=list(COLUMNS))


def read_frames(
    path: Path, player: str, names: Sequence[str], more: Sequence[str] = ()
) -> tuple[pd.DataFrame, pd.DataFrame, Path]:
    """The rows of ``NN_tracks.csv``, and the metadata in ``NN_recordingMeta.csv`` and their path.

    ``player`` is the column of the players' names, ``names`` those of numbers; ``time`` [s] comes
    from ``frame`` and the frame rate. ``more`` columns of the metadata are read if they are there.
    """
    rows = numbers(path, read_columns(path, (player, "frame", *names)), ("frame", *names))
    meta_path = companion(path, "recordingMeta", "frame rate")
    meta = read_columns(meta_path, ("frameRate",), more)
    rows["time"] = rows["frame"] / frame_rate(meta, meta_path)
    return rows.assign(player=player_names(rows[player])), meta, meta_path


def companion(path: Path, suffix: str, purpose: str) -> Path:
    """The file ``NN_<suffix>.csv`` beside ``NN_tracks.csv``."""
    stem = path.stem.removesuffix("_tracks")
    beside = path.with_name(f"{stem}_{suffix}.csv")
    if not beside.is_file():
        raise UserError(f"{path}: its {purpose} is in {beside.name!r}, which is not beside it")
    return beside


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


def listed(names: Sequence[str]) -> str:
    """The first few names as text, for messages."""
    more = len(names) - _SHOWN
    shown = (f"{n[:_SHOWN_NAME]}..." if len(n) > _SHOWN_NAME else n for n in names[:_SHOWN])
    return ", ".join(shown) + (f" and {more} more" if more > 0 else "")


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
