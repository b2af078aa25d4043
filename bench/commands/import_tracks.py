"""``olne-bench import``: a recording out of a user's own tracks."""

from pathlib import Path

import click

from olne_bench.bench.commands.options import PATH
from olne_bench.envs.recording_file import write_recording
from olne_bench.envs.tracks import ignored_columns, read_tracks
from olne_bench.files import check_new_file


@click.command(name="import")
@click.argument("tracks", type=PATH)
@click.option("--out", type=PATH, required=True, help="Parquet file, a new one.")
def import_tracks(tracks: Path, out: Path) -> None:
    """Make a recording out of TRACKS, a CSV file, with no truth known.

    Columns: time [s], player, x [m], y [m], and where known heading [rad] and speed [m/s]. All
    players have rows at all times, which are equally spaced; empty cells are missing samples.
    """
    check_new_file("--out", out, (".parquet",))
    recording = read_tracks(tracks)
    ignored = ignored_columns(tracks)
    if ignored:
        click.echo(f"not used: column {', '.join(ignored)}", err=True)
    write_recording(out, recording)
    steps, players, _ = recording.states[0].shape
    click.echo(f"{out}: {players} players, {steps} steps of {recording.metadata.dt:g} s")
