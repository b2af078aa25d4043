"""``olne-bench import``: make a recording from a user's own tracks."""

from pathlib import Path

import click
import numpy as np

from olne_bench.bench.commands.options import PATH, FiniteRange, plain_number
from olne_bench.bench.text import one_line
from olne_bench.envs.recording_file import write_recording
from olne_bench.envs.track_formats import format_names
from olne_bench.envs.tracks.frames import Frame
from olne_bench.envs.tracks.grid import Excerpt
from olne_bench.envs.tracks.reading import read_tracks
from olne_bench.files import check_new_file


class NumberPair(click.ParamType):
    """Two finite numbers, separated by a comma."""

    name = "A,B"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float]:
        """Both numbers.

        Raises:
            click.BadParameter: on anything else.
        """
        try:
            first, second = map(plain_number, str(value).split(","))
        except ValueError:
            self.fail(f"{value!r} is not a pair of numbers A,B.", param, ctx)
        if not np.isfinite([first, second]).all():
            self.fail(f"{value!r} is not a pair of finite numbers.", param, ctx)
        return first, second


class Window(NumberPair):
    """Two increasing times."""

    name = "FROM,TO"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float]:
        """Both times.

        Raises:
            click.BadParameter: on anything else.
        """
        first, last = super().convert(value, param, ctx)
        if not first < last:
            self.fail(f"{value!r} does not begin before it ends.", param, ctx)
        return first, last


@click.command(name="import")
@click.argument("tracks", type=PATH)
@click.option("--out", type=PATH, required=True, help="New Parquet file.")
@click.option(
    "--format",
    "format_name",
    default="csv",
    show_default=True,
    metavar="|".join(format_names()),
    help="What kind of file TRACKS is.",
)
@click.option(
    "--road",
    type=PATH,
    help="TOML file of lanes and targets, SUMO's .net.xml or a lanelet2 map (.osm). Default: the "
    "TOML file beside TRACKS that has its name, if there is one.",
)
@click.option("--window", type=Window(), help="First and last time [s].")
@click.option("--players", help="Names, separated by commas. Default: all.")
@click.option(
    "--resample",
    type=FiniteRange(min=0.001, max=10),
    help="Time step of the recording [s]. Default: that of the tracks.",
)
@click.option("--part", help="Part of a file whose player names repeat, such as a case.")
@click.option("--flip-y", is_flag=True, help="Reverse the direction of y.")
@click.option("--rotate", type=FiniteRange(), default=0.0, help="Then rotate the tracks [degrees].")
@click.option("--shift", type=NumberPair(), default="0,0", help="Then shift them by x,y [m].")
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
    """Make a recording from TRACKS, whose true weights are unknown.

    Rows may be in any order. Cars that enter or leave have missing samples while they are not
    seen. --flip-y, --rotate and --shift bring tracks into the frame of the lanes; they do not
    move the lanes.
    """
    check_new_file("--out", out, (".parquet",))
    names = tuple(name.strip() for name in players.split(",")) if players else ()
    imported = read_tracks(
        tracks,
        format_name,
        excerpt=Excerpt(window, names, resample),
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
