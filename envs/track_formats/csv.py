"""Plain tables: time [s], player, x [m], y [m], and, if known, heading [rad] and speed [m/s]."""

from pathlib import Path

from olne_bench.envs.tracks.cells import OPTIONAL, REQUIRED, read_cells, read_numbers
from olne_bench.envs.tracks.table import Tracks
from olne_bench.errors import UserError

DESCRIPTION = "columns time [s], player, x and y [m], heading [rad] and speed [m/s] where known"


def read(path: Path, part: str | None) -> Tracks:
    """Read one row per time and player, in any order; see ``track_formats``."""
    if part is not None:
        raise UserError(f"--part {part!r}: files of this format have no parts")
    ignored = [name for name in read_cells(path).columns if name not in REQUIRED + OPTIONAL]
    notes = (f"not used: column {', '.join(ignored)}",) if ignored else ()
    return Tracks(read_numbers(path), notes=notes)
