"""Plain tables: time [s], player, x [m], y [m], and, if known, heading [rad] and speed [m/s]."""

from pathlib import Path

from olne_bench.envs.tracks.table import COLUMNS, Tracks, no_parts, numbers
from olne_bench.envs.tracks.text import read_sheet
from olne_bench.errors import UserError

DESCRIPTION = "columns time [s], player, x and y [m], heading [rad] and speed [m/s] where known"
REQUIRED = ("time", "player", "x", "y")
_CLASSES = ("class", "agent_type", "type")  # names of the column of classes


def read(path: Path, part: str | None) -> Tracks:
    """Read one row per time and player, in any order; see ``track_formats``."""
    no_parts(part)
    sheet = read_sheet(path)
    optional = [name for name in COLUMNS if name not in (*REQUIRED, "class")]
    rows = sheet.columns(REQUIRED, (*optional, *_CLASSES), ("player", *_CLASSES))
    rows.index += sheet.first - 1
    rows = numbers(
        path, rows, [name for name in ("time", *optional, "x", "y") if name in rows], "line"
    )
    untimed = rows.index[rows["time"].isna()]
    if len(untimed):
        raise UserError(f"{path}, line {untimed[0] + 1}: the row has no time")
    found = [name for name in _CLASSES if name in rows]
    rows["player"] = rows["player"].str.strip()
    used = {*COLUMNS[:-1], *found[:1]}
    ignored = [name for name in sheet.titles if name.lower() not in used]
    table = rows.rename(columns={found[0]: "class"} if found else {})
    notes = (f"not used: column {', '.join(ignored)}",) if ignored else ()
    return Tracks(table.reindex(columns=list(COLUMNS)).reset_index(drop=True), notes=notes)
