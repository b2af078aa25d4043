"""Plain tables: time [s], player, x [m], y [m], and, if known, heading [rad] and speed [m/s]."""

from pathlib import Path

import pandas as pd

from olne_bench.envs.tracks.table import (
    COLUMNS,
    Tracks,
    check_titles,
    no_parts,
    numbers,
    read_titles,
)
from olne_bench.errors import UserError, bad_input

DESCRIPTION = "columns time [s], player, x and y [m], heading [rad] and speed [m/s] where known"
REQUIRED = ("time", "player", "x", "y")
_MISSING = {"", "nan", "na", "n/a", "null"}


def read(path: Path, part: str | None) -> Tracks:
    """Read one row per time and player, in any order; see ``track_formats``."""
    no_parts(part)
    cells = _cells(path)
    ignored = [name for name in cells.columns if name not in COLUMNS]
    cells = cells.reindex(columns=list(COLUMNS), fill_value="")
    cells = cells.apply(lambda column: column.str.strip())
    values = cells.drop(columns="player")
    values = values.mask(values.apply(lambda column: column.str.lower().isin(_MISSING)))
    table = cells[["player"]].join(numbers(path, values, list(values.columns), "line"))
    for name, empty in (("player", table["player"] == ""), ("time", table["time"].isna())):
        if empty.any():
            raise UserError(f"{path}, line {empty.idxmax() + 1}: the row has no {name}")
    notes = (f"not used: column {', '.join(ignored)}",) if ignored else ()
    return Tracks(table, notes=notes)


def _cells(path: Path) -> pd.DataFrame:
    """The cells as text, without blank lines; the first line has the index 0."""
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
    return rows[(rows != "").any(axis=1)]
