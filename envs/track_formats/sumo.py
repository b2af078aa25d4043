"""SUMO: its floating car data (``--fcd-output``) and its networks (``.net.xml``).

Floating car data are XML with a row per vehicle and time step. Positions are those of the centre of
the front bumper; angles are in degrees clockwise from north.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd

from olne_bench.envs.tracks.road import MOST_MAP_BYTES, Road, RoadLane, curves_through
from olne_bench.envs.tracks.table import COLUMNS, MOST_BYTES, Tracks, no_parts, plain_float
from olne_bench.errors import UserError, bad_input
from olne_bench.files import check_input

DESCRIPTION = "SUMO: XML of --fcd-output; lanes from its network by --road FILE.net.xml"
WIDTH = 3.2  # [m], SUMO's default width of a lane
LENGTH = 5.0  # [m], SUMO's default length of a passenger car


def read(path: Path, part: str | None) -> Tracks:
    """Read the vehicles; see ``track_formats``."""
    no_parts(part)
    check_input("tracks file", path, MOST_BYTES)
    what = f"{path} is not floating car data of SUMO"
    with bad_input(what, OSError):
        rows = pd.DataFrame(
            _vehicles(path, what), columns=["time", "player", "x", "y", "angle", "speed"]
        )
    heading = np.deg2rad(90 - rows["angle"])
    table = rows.assign(
        heading=heading,
        x=rows["x"] - LENGTH / 2 * np.cos(heading),
        y=rows["y"] - LENGTH / 2 * np.sin(heading),
    )
    note = f"SUMO gives positions of front bumpers; cars are assumed to be {LENGTH:g} m long"
    return Tracks(table[list(COLUMNS)], notes=(note,))


def _vehicles(path: Path, what: str) -> Iterator[tuple[float, str, float, float, float, float]]:
    time = np.nan
    for event, element in ElementTree.iterparse(path, events=("start", "end")):
        if element.tag == "timestep":
            if event == "start":
                time = plain_float(element.attrib["time"])
            else:
                element.clear()
        elif element.tag == "vehicle" and event == "end":
            known = element.attrib
            with bad_input(f"{what}: vehicle {known.get('id')!r} at time {time:g}"):
                x, y, angle, speed = (
                    plain_float(known[name]) for name in ("x", "y", "angle", "speed")
                )
                yield time, known["id"], x, y, angle, speed


def read_net(path: Path) -> Road:
    """Read the lanes for cars, including those inside junctions, and their successors."""
    check_input("road file", path, MOST_MAP_BYTES)
    with bad_input(f"{path} is not a SUMO network", OSError):
        net = ElementTree.parse(path).getroot()
        if net.tag != "net":
            raise UserError(f"{path} is not a SUMO network: its root is <{net.tag}>, not <net>")
        following = _following(net)
        lanes = {
            lane.attrib["id"]: _road_lane(path, lane, following.get(lane.attrib["id"], ()))
            for edge in net.iter("edge")
            if edge.get("function") not in ("crossing", "walkingarea")
            for lane in edge.findall("lane")
            if _is_for_cars(lane)
        }
        return Road(lanes)


def _road_lane(path: Path, lane: ElementTree.Element, following: Sequence[str]) -> RoadLane:
    with bad_input(f"{path} is not a SUMO network: lane {lane.attrib['id']!r}"):
        points = [
            [plain_float(value) for value in point.split(",")[:2]]
            for point in lane.attrib["shape"].split()
        ]
        width = plain_float(lane.get("width", str(WIDTH)))
        return RoadLane(curves_through(points), width, tuple(following))


def _following(net: ElementTree.Element) -> dict[str, list[str]]:
    """Successors of each lane; before a junction, the lane that leads through it."""
    result: dict[str, list[str]] = {}
    for link in net.iter("connection"):
        start = f"{link.attrib['from']}_{link.attrib['fromLane']}"
        end = f"{link.attrib['to']}_{link.attrib['toLane']}"
        result.setdefault(start, []).append(link.get("via", end))
    return result


def _is_for_cars(lane: ElementTree.Element) -> bool:
    allowed, refused = lane.get("allow", "all").split(), lane.get("disallow", "").split()
    return bool({"passenger", "all"} & set(allowed)) and not {"passenger", "all"} & set(refused)
