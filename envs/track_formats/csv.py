"""Plain tables: time [s], player, x [m], y [m], and, if known, heading [rad] and speed [m/s]."""

from pathlib import Path

import numpy as np
import pandas as pd

from olne_bench.envs.tracks.table import STATE_NAMES, Tracks, check_titles, read_titles
from olne_bench.errors import UserError, bad_input

REQUIRED = ("time", "player", "x", "y")
OPTIONAL = ("heading", "speed")
_MISSING = {"", "nan", "na", "n/a", "null"}
_SHOWN = 60  # characters of a cell in a message
_FIRST_LINE = 2  # the first line of data, after the header


def read_numbers(path: Path) -> pd.DataFrame:
    """The columns of tracks, indexed by line number; absent optional columns are NaN."""
    cells = read_cells(path)
    table = pd.DataFrame({"player": cells["player"].str.strip()}, index=cells.index)
    _require(path, table["player"], "player")
    for name in ("time", *STATE_NAMES):
        if name in cells.columns:
            table[name] = _numbers(path, cells[name].str.strip(), name)
        else:
            table[name] = np.nan
    _require(path, cells["time"].where(table["time"].notna(), ""), "time")
    return table


def read_cells(path: Path) -> pd.DataFrame:
    """The cells as text, indexed by line number, without blank lines."""
    if path.is_file() and not path.stat().st_size:
        raise UserError(f"{path} is empty; expected the columns {', '.join(REQUIRED)}")
    names = read_titles(path)
    check_titles(path, names, [name for name in REQUIRED if name not in names])
    again = [name for name in names if names.count(name) > 1]
    if again:
        raise UserError(f"{path}: column {again[0]!r} appears twice")
    with bad_input(f"{path} is not a CSV file", OSError):
        cells = pd.read_csv(
            path,
            dtype=str,
            header=None,
            index_col=False,
            keep_default_na=False,
            skip_blank_lines=False,
            encoding="utf-8-sig",
        )
    rows = cells.iloc[1:].fillna("").set_axis(names, axis=1)
    rows.index += _FIRST_LINE - 1  # line numbers, so that messages can name them
    return rows[(rows != "").any(axis=1)]  # without blank lines


def _numbers(path: Path, cells: pd.Series, name: str) -> pd.Series:
    known = ~cells.str.lower().isin(_MISSING)
    numbers = pd.to_numeric(cells.where(known), errors="coerce").astype(float)
    wrong = known & ~np.isfinite(numbers)
    if wrong.any():
        line = _first_line(wrong)
        raise UserError(
            f"{path}, line {line}: {name} is {cells[line][:_SHOWN]!r}, expected a finite number"
        )
    return numbers


def _first_line(wrong: pd.Series) -> int:
    return int(wrong.index.to_numpy()[wrong.to_numpy().argmax()])


def _require(path: Path, cells: pd.Series, name: str) -> None:
    empty = cells == ""
    if empty.any():
        raise UserError(f"{path}, line {_first_line(empty)}: the row has no {name}")


DESCRIPTION = "columns time [s], player, x and y [m], heading [rad] and speed [m/s] where known"


def read(path: Path, part: str | None) -> Tracks:
    """Read one row per time and player, in any order; see ``track_formats``."""
    if part is not None:
        raise UserError(f"--part {part!r}: files of this format have no parts")
    ignored = [name for name in read_cells(path).columns if name not in REQUIRED + OPTIONAL]
    notes = (f"not used: column {', '.join(ignored)}",) if ignored else ()
    return Tracks(read_numbers(path), notes=notes)
