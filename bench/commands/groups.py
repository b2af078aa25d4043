"""``olne-bench groups``: which cars of a file interact."""

from pathlib import Path

import click
import pandas as pd

from olne_bench.bench.commands.interface.recordings import MOST_OF_GROUP
from olne_bench.bench.text import one_line
from olne_bench.envs.tracks.grid import Excerpt
from olne_bench.envs.tracks.groups import groups_in
from olne_bench.envs.tracks.reading import ANY, grid_and_road, read_tracks
from olne_bench.errors import UserError

#: Options that need not be repeated: those that have these values.
_USUAL = {"format": "csv", "most": MOST_OF_GROUP}


def groups(
    tracks: Path,
    format_name: str,
    road: Path | None,
    window: tuple[float, float] | None,
    part: str | None,
    most: int,
    rows: int,
) -> None:
    """List the cars in TRACKS that interact."""
    imported = read_tracks(
        tracks, format_name, excerpt=Excerpt(window, most=ANY), road=road, part=part
    )
    for note in imported.notes:
        if not note.startswith("player "):  # who enters and leaves
            click.echo(one_line(note), err=True)
    grid, lanes = grid_and_road(imported.recording)
    found = groups_in(grid, lanes, most)
    if not found:
        why = "" if lanes else "; without lanes only crossing ways are found, give them by --road"
        raise UserError(f"{tracks}: nobody interacts{why}")
    lines = []
    for number, group in enumerate(found[:rows], 1):
        first = group.interactions[:3]
        reasons = "; ".join(f"{one.who} {one.what} {one.whom}" for one in first)
        more = len(group.interactions) - len(first)
        lines.append(
            {
                "group": number,
                "from": f"{group.window[0]:g}",
                "to": f"{group.window[1]:g}",
                "players": ",".join(group.players),
                "why": reasons + (f"; {more} more" if more else ""),
            }
        )
    table = pd.DataFrame(lines).map(lambda value: one_line(str(value)))
    click.echo(table.to_string(index=False, justify="left"))
    if len(found) > rows:
        click.echo(f"{len(found) - rows} weaker groups are not shown; --rows shows more")
    given = {"format": format_name, "road": road, "part": part, "most": most}
    given |= {"window": None if window is None else "{:g},{:g}".format(*window)}
    asked = "".join(f" --{k} {v}" for k, v in given.items() if v not in (None, _USUAL.get(k)))
    click.echo(f"'olne-bench import {tracks}{asked} --group 1 --out NEW.parquet' takes the first")
