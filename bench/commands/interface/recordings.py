"""How the commands on recordings are called."""

import click

from olne_bench.bench.commands.options import (
    BUDGET,
    JOBS,
    PATH,
    Finite,
    FiniteRange,
    command,
    memory_option,
    names,
    number_pair,
    several,
    shown,
    window,
)

#: Repeats ``envs.track_formats.format_names()``, whose import is slow.
FORMATS = ("commonroad", "csv", "highd", "ind", "interaction", "ngsim", "sumo")

#: Cars of a group at most.
MOST_OF_GROUP = 5

_most = shown(
    "--most",
    type=click.IntRange(2, 20),
    default=MOST_OF_GROUP,
    help="Largest number of cars of a group.",
)


@command()
@click.argument("scenario")
@shown(
    "--seeds",
    type=click.IntRange(min=1),
    default=1,
    help="Number of draws to play, from seed 0 on; a fixed scenario has only one.",
)
@click.option("--out", type=PATH, required=True, help="New Parquet file.")
@click.option("--video", type=PATH, help="New GIF or MP4 file of the first draw.")
@several(
    "--option",
    "options",
    metavar="NAME=VALUE",
    help="An option of the scenario, such as num_players=3 (repeatable).",
)
def record() -> None:
    """Play SCENARIO at its equilibrium and write the recording.

    A draw without a certified equilibrium, locally or globally so far, is named in the summary and
    not written.
    """


@command("import")
@click.argument("tracks", type=PATH)
@click.option("--out", type=PATH, required=True, help="New Parquet file.")
@shown(
    "--format",
    "format_name",
    default="csv",
    metavar="|".join(FORMATS),
    help="What kind of file TRACKS is.",
)
@click.option(
    "--road",
    type=PATH,
    help="TOML file of lanes and targets, SUMO's .net.xml or a lanelet2 map (.osm, .osm_xy). "
    "Default: the TOML file beside TRACKS that has its name, if there is one.",
)
@click.option("--window", type=window, metavar="FROM,TO", help="First and last time [s].")
@click.option(
    "--players",
    type=names,
    default="",
    help="Names, separated by commas; in quotes if they have commas. Default: all vehicles.",
)
@click.option(
    "--group",
    type=click.IntRange(min=1),
    help="Take the players and times of this group of 'olne-bench groups'.",
)
@_most
@click.option(
    "--resample",
    type=FiniteRange(min=0.001, max=10),
    help="Time step of the recording [s]. Default: that of the tracks.",
)
@click.option("--part", help="Part of a file whose player names repeat, such as a case.")
@click.option("--flip-y", is_flag=True, help="Reverse the direction of y.")
@click.option("--rotate", type=Finite(), default=0.0, help="Then rotate the tracks [degrees].")
@click.option(
    "--shift", type=number_pair, metavar="A,B", default="0,0", help="Then shift them by x,y [m]."
)
def import_tracks() -> None:
    """Make a recording from TRACKS, whose true weights are unknown.

    Rows may be in any order. Cars that enter or leave have missing samples while they are not
    seen. Pedestrians, cyclists and what is parked are left out unless --players names them.
    --flip-y, --rotate and --shift bring tracks into the frame of the lanes; they do not move the
    lanes.
    """


@command()
@click.argument("tracks", type=PATH)
@shown("--format", "format_name", default="csv", metavar="|".join(FORMATS), help="What TRACKS is.")
@click.option("--road", type=PATH, help="Lanes, as for 'olne-bench import'.")
@click.option("--window", type=window, metavar="FROM,TO", help="First and last time [s].")
@click.option("--part", help="Part of a file whose player names repeat.")
@_most
@shown("--rows", type=click.IntRange(min=1), default=10, help="Number of groups to list.")
def groups() -> None:
    """List the cars in TRACKS that interact, the strongest groups first, and say why.

    A car follows another, changes into its lane ahead of it, or crosses its way within seconds.
    """


@command()
@click.argument("tracks", type=PATH)
@shown("--format", "format_name", default="csv", metavar="|".join(FORMATS), help="What TRACKS is.")
@click.option("--road", type=PATH, help="Lanes, as for 'olne-bench import'.")
@click.option("--part", help="Part of a file whose player names repeat.")
@click.option("--at", type=Finite(), help="Last time that is seen [s]. Default: the last one.")
@shown("--ahead", type=FiniteRange(min=0), default=3.0, help="How far to look ahead [s].")
@click.option(
    "--players", type=names, default="", help="Whom to predict, separated by commas. Default: all."
)
@click.option("--out", type=PATH, help="New CSV file of positions and errors.")
@click.option("--picture", type=PATH, help="New PNG, SVG or PDF file.")
@click.option("--film", type=PATH, help="New GIF or MP4 file, a frame for each 0.2 s.")
def predict() -> None:
    """Predict where the cars in TRACKS, or in a recording, will be.

    Each car plays a game with those ahead of it in its lane (scenario 'following', equal weights).
    Beside it stands driving straight on along the lane. Where the file goes on after --at, errors
    are shown. Regions are those that held 90 % of recorded drivers.
    """


@command()
@click.argument("data", type=PATH)
@shown(
    "--format", "format_name", default="commonroad", metavar="|".join(FORMATS), help="What DATA is."
)
@click.option("--out", type=PATH, required=True, help="Folder for errors, table and figure.")
@click.option("--open", "second", is_flag=True, help="Open the second half of the recordings.")
@click.option("--weights", is_flag=True, help="Also weights of each driver, up to a minute each.")
@shown("--jobs", type=JOBS, default=2, help="Number of processes.")
def people() -> None:
    """Measure how well the drivers in DATA, a folder of recordings with lanes, are predicted.

    Each car counts once. Beside the game of 'predict' stand driving straight on, the intelligent
    driver model and regressions, which are fitted to other recordings. One half of them is there
    to develop on; --open shows the other half, once, and records that in the folder.
    """


@command()
@click.argument("recording", type=PATH)
@shown("--episode", type=click.IntRange(min=0), default=0, help="Episode to write.")
@click.option("--out", type=PATH, required=True, help="New CSV or CommonRoad XML file.")
def export() -> None:
    """Write the motion in RECORDING as a table or a CommonRoad scenario.

    Lanes and the players' targets go to a TOML file of the same name beside it. Weights are not
    written: 'olne-bench import' and 'olne-bench estimate' recover them.
    """


@command()
@click.argument("recording", type=PATH)
@click.option(
    "--scenario",
    help="Scenario whose cost features the players have. Default: that of the recording.",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    help="Draw of the scenario family that the tracks show; players that start there get its "
    "targets.",
)
@shown("--estimator", default="kkt_constrained", help="Name, or FILE.py[:CLASS].")
@shown("--episode", type=click.IntRange(min=0), default=0, help="Episode to use.")
@click.option(
    "--noise",
    type=FiniteRange(min=0, min_open=True),
    help="Standard deviation of position noise [m]. Default: estimated with the weights.",
)
@shown(
    "--ahead",
    type=FiniteRange(min=0),
    default=0.0,
    help="How long after the recording the players' plans end [s]; drivers plan some seconds.",
)
@shown(
    "--targets",
    type=click.Choice(["estimated", "fixed"]),
    default="estimated",
    help="Target speeds and places in the lane that are guessed from the data.",
)
@shown(
    "--budget",
    type=BUDGET,
    default=60.0,
    help="Time limit of the estimate [s], without compilation.",
)
@click.option("--out", type=PATH, help="New CSV file for the weights.")
def estimate() -> None:
    """Estimate the weights of every player in RECORDING.

    Motion model, cost features and noise scales are those of the scenario. Target speeds, lanes
    and goals are taken from the recording's road file, from a draw with the same start, from the
    scenario or from the data; each is printed with its source. Tracks that leave the road or run
    against its lanes are refused.
    """


@command()
@click.argument("road")
@click.option("--out", type=PATH, required=True, help="The film: MP4 or GIF.")
@shown(
    "--suite",
    default="driving",
    help="Suite of drives that says traffic, noise and rules, such as encounters.",
)
@shown(
    "--planner",
    multiple=True,
    default=("oracle",),
    help="Who drives the ego. Several have the same start, side by side.",
)
@shown("--seed", type=click.IntRange(0, 10**6), default=0)
@memory_option("Memory limit of the estimator's process.")
def film() -> None:
    """Write a drive on ROAD as a video, with the ego's plan and what it expects of others."""
