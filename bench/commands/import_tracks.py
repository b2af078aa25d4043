"""``olne-bench import``: make a recording from a user's own tracks."""

import csv
from pathlib import Path

import click
import numpy as np

from olne_bench.bench.text import one_line
from olne_bench.envs.recordings.recording_file import write_recording
from olne_bench.envs.tracks.grid import Excerpt, Frame
from olne_bench.envs.tracks.reading import read_tracks
from olne_bench.files import check_new_file


def import_tracks(
    tracks: Path,
    out: Path,
    format_name: str,
    road: Path | None,
    window: tuple[float, float] | None,
    players: str | None,
    resample: float | None,
    part: str | None,
    flip_y: bool,
    rotate: float,
    shift: tuple[float, float],
) -> None:
    """Make a recording from TRACKS, whose true weights are unknown."""
    check_new_file("--out", out, (".parquet",))
    names = next(csv.reader([players or ""], skipinitialspace=True), [])
    imported = read_tracks(
        tracks,
        format_name,
        excerpt=Excerpt(window, tuple(name.strip() for name in names), resample),
        frame=Frame(flip_y, float(np.deg2rad(rotate)), shift),
        road=road,
        part=part,
    )
    for note in imported.notes:
        click.echo(one_line(note), err=True)
    write_recording(out, imported.recording)
    steps, count, _ = imported.recording.states[0].shape
    step = imported.recording.metadata.dt
    click.echo(f"{out}: {count} players, {steps} steps of {step:.6g} s")
