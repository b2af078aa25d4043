"""Lanes of a SUMO network (``.net.xml``)."""

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

from olne_bench.envs.tracks.curve_fit import curves_through
from olne_bench.envs.tracks.road import MOST_MAP_BYTES, Road, RoadLane
from olne_bench.envs.tracks.table import plain_float
from olne_bench.errors import UserError, bad_input
from olne_bench.files import check_input

WIDTH = 3.2  # [m], SUMO's default width of a lane


def read_net(path: Path) -> Road:
    """Read the lanes for cars, including those inside junctions, and their successors.

    Raises:
        UserError: if the file is missing or not a network.
    """
    check_input("road file", path, MOST_MAP_BYTES)
    with bad_input(f"{path} is not a SUMO network", OSError):
        net = ElementTree.parse(path).getroot()
        if net.tag != "net":
            raise UserError(f"{path} is not a SUMO network: its root is <{net.tag}>, not <net>")
        following = _following(net)
        lanes = {
            lane.attrib["id"]: _road_lane(path, lane, following)
            for edge in net.iter("edge")
            if edge.get("function") not in ("crossing", "walkingarea")
            for lane in edge.findall("lane")
            if _is_for_cars(lane)
        }
        return Road(lanes)


def _road_lane(
    path: Path, lane: ElementTree.Element, following: Mapping[str, list[str]]
) -> RoadLane:
    name = lane.attrib["id"]
    with bad_input(f"{path} is not a SUMO network: lane {name!r}"):
        return RoadLane(
            curves_through(_points(lane.attrib["shape"])),
            plain_float(lane.get("width", str(WIDTH))),
            tuple(following.get(name, ())),
        )


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


def _points(shape: str) -> list[list[float]]:
    return [[plain_float(value) for value in point.split(",")[:2]] for point in shape.split()]
