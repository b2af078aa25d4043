"""SUMO: its floating car data (``--fcd-output``) and its networks (``.net.xml``).

Floating car data are XML with a row per vehicle and time step. Positions are those of the centre of
the front bumper; angles are in degrees clockwise from north.
"""

from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd

from olne_bench.envs.tracks.fronts import centred, travel
from olne_bench.envs.tracks.road import (
    MOST_MAP_BYTES,
    Road,
    RoadLane,
    curves_through,
    left_out,
    read_lanes,
    with_lanes,
)
from olne_bench.envs.tracks.table import COLUMNS, Tracks, no_parts, plain_float
from olne_bench.envs.tracks.text import MOST_BYTES, read_bytes, read_xml
from olne_bench.errors import UserError, bad_input, reason

DESCRIPTION = "SUMO: XML of --fcd-output; lanes from its network by --road FILE.net.xml"
WIDTH = 3.2  # [m], SUMO's default width of a lane
LENGTH = 5.0  # [m], SUMO's default length of a passenger car
_NOWHERE = -(2.0**30)  # coordinates of a vehicle that is on no lane
_OTHERS = ("person", "container")
_Row = tuple[float, str, float, float, float, float, float, str]


def read(path: Path, part: str | None) -> Tracks:
    """Read the vehicles; see ``track_formats``."""
    no_parts(part)
    data = read_bytes("tracks file", path, MOST_BYTES)
    wrong: list[str] = []
    with bad_input(f"{path} is not floating car data of SUMO", OSError):
        rows = pd.DataFrame(_rows(data, wrong), columns=list(COLUMNS))
        if wrong and rows.empty:
            raise ValueError(wrong[0])
    if rows.empty:
        raise UserError(f"{path} has no vehicles")
    nowhere = rows["x"].isna() | rows["y"].isna() | (rows["x"] == _NOWHERE)
    table = rows[~nowhere].reset_index(drop=True)
    ahead = table["length"].fillna(LENGTH) / 2
    table = centred(table, table["heading"].fillna(travel(table)), ahead)
    notes = list(left_out(wrong))
    if nowhere.any():
        notes.append(f"left out, without a position: {nowhere.sum()} rows")
    if table["length"].isna().any():
        notes.append(
            f"SUMO gives positions of front bumpers; cars are assumed to be {LENGTH:g} m long"
        )
    return Tracks(table, notes=tuple(notes))


def _rows(data: bytes, wrong: list[str]) -> Iterator[_Row]:
    """The rows that can be read; what is wrong with others is added."""
    time, root = np.nan, ""
    for event, element in ElementTree.iterparse(BytesIO(data), events=("start", "end")):
        if not root:
            root = element.tag
            if root != "fcd-export":
                raise ValueError(f"its root is <{root}>, not <fcd-export>")
        if element.tag == "timestep":
            if event == "start":
                time = plain_float(element.attrib["time"])
            else:
                element.clear()
        elif element.tag in ("vehicle", *_OTHERS) and event == "end":
            try:
                yield _row(time, element)
            except (KeyError, ValueError) as error:
                who = f"{element.tag} {element.get('id')!r} at time {time:g}"
                wrong.append(f"{who}: {reason(error)}")


def _row(time: float, element: ElementTree.Element) -> _Row:
    """What is known of a vehicle, a person or a container; a person's position is its centre."""
    known, other = element.attrib, element.tag in _OTHERS
    x, y, angle, speed, length = (
        plain_float(known.get(name, "nan")) for name in ("x", "y", "angle", "speed", "length")
    )
    kind = element.tag if other else known.get("type", "")
    return time, known["id"], x, y, np.deg2rad(90 - angle), speed, 0.0 if other else length, kind


def read_net(path: Path) -> Road:
    """Read the lanes for cars that can be read, inside junctions too, and their successors."""
    with bad_input(f"{path} is not a SUMO network", OSError):
        net = read_xml("road file", path, MOST_MAP_BYTES, "net")
        following = _following(net)
        lanes = {
            lane.attrib["id"]: lane
            for edge in net.iter("edge")
            if edge.get("function") not in ("crossing", "walkingarea")
            for lane in edge.findall("lane")
            if _is_for_cars(lane)
        }
        named = {name: following.get(name, []) for name in lanes}
        return with_lanes(read_lanes(named, lambda name: _lane(lanes[name])))


def _lane(lane: ElementTree.Element) -> RoadLane:
    points = [
        [plain_float(value) for value in point.split(",")[:2]]
        for point in lane.attrib["shape"].split()
    ]
    return RoadLane(curves_through(points), plain_float(lane.get("width", str(WIDTH))))


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
