"""``olne-bench import``: make a recording from a user's own tracks."""

import math
from typing import Any

import click

from olne_bench.bench.commands.options import PATH, FiniteRange, plain_number

#: Repeats ``envs.track_formats.format_names()``, whose import is slow.
FORMATS = ("commonroad", "csv", "highd", "ind", "interaction", "ngsim", "sumo")


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
        if not (math.isfinite(first) and math.isfinite(second)):
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
    metavar="|".join(FORMATS),
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
def import_tracks(**given: Any) -> None:
    """Make a recording from TRACKS, whose true weights are unknown.

    Rows may be in any order. Cars that enter or leave have missing samples while they are not
    seen. --flip-y, --rotate and --shift bring tracks into the frame of the lanes; they do not
    move the lanes.
    """
    from olne_bench.bench.commands.import_tracks import import_tracks as work

    work(**given)
