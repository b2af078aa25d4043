"""``olne-bench import``: make a recording from a user's own tracks."""

from functools import partial
from pathlib import Path

import click
import numpy as np

from olne_bench.bench.text import one_line
from olne_bench.envs.recordings.recording_file import RecordingFile, write_recording
from olne_bench.envs.tracks.grid import Excerpt, Frame
from olne_bench.envs.tracks.groups import Group, groups_in
from olne_bench.envs.tracks.reading import ANY, grid_and_road, read_tracks
from olne_bench.errors import UserError
from olne_bench.files import check_new_file


def import_tracks(
    tracks: Path,
    out: Path,
    format_name: str,
    road: Path | None,
    window: tuple[float, float] | None,
    players: tuple[str, ...],
    group: int | None,
    most: int,
    resample: float | None,
    part: str | None,
    flip_y: bool,
    rotate: float,
    shift: tuple[float, float],
) -> None:
    """Make a recording from TRACKS, whose true weights are unknown."""
    check_new_file("--out", out, (".parquet",))
    frame = Frame(flip_y, float(np.deg2rad(rotate)), shift)
    read = partial(read_tracks, tracks, format_name, frame=frame, road=road, part=part)
    if group is not None:
        if players:
            raise UserError("--group and --players: give one of them")
        whole = read(excerpt=Excerpt(window, most=ANY)).recording
        chosen = _group(tracks, whole, group, most)
        players, window = chosen.players, chosen.window
    imported = read(excerpt=Excerpt(window, players, resample))
    for note in imported.notes:
        click.echo(one_line(note), err=True)
    write_recording(out, imported.recording)
    steps, count, _ = imported.recording.states[0].shape
    step = imported.recording.metadata.dt
    click.echo(f"{out}: {count} players, {steps} steps of {step:.6g} s")


def _group(tracks: Path, whole: RecordingFile, number: int, most: int) -> Group:
    found = groups_in(*grid_and_road(whole), most)
    if number > len(found):
        raise UserError(f"--group {number}: 'olne-bench groups {tracks}' lists {len(found)}")
    return found[number - 1]
