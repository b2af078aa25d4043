"""``olne-bench export``: a recording's motion as CSV or CommonRoad, with a road file beside it."""

from pathlib import Path

import click

from olne_bench.bench.commands.recordings import read_episode
from olne_bench.envs.tracks.export import Episode, renamed, write_commonroad, write_csv
from olne_bench.envs.tracks.road_file import write_road_file
from olne_bench.files import check_new_file

SUFFIXES = (".csv", ".xml")


def export(recording: Path, episode: int, out: Path) -> None:
    """Write the motion in RECORDING as a table or a CommonRoad scenario."""
    check_new_file("--out", out, SUFFIXES)
    beside = out.with_suffix(".toml")
    check_new_file("--out", beside, (".toml",))
    written = Episode.of(read_episode(recording, episode), episode)
    road = written.road
    if out.suffix.lower() == ".csv":
        write_csv(out, written)
    else:
        numbers = write_commonroad(out, written)
        road = renamed(road, numbers) if road else None
    if road is not None:
        write_road_file(beside, road)
    steps, count, _ = written.states.shape
    click.echo(f"{out}: {count} players, {steps} steps of {written.dt:.6g} s")
    click.echo(f"{beside}: lanes and targets" if road else "no lanes or targets are known")
