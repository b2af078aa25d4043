"""CommonRoad scenarios (XML): their dynamic obstacles and their lanelets.

The versions 2018b and 2020a are read without commonroad-io, which refuses a file for one element
that is wrong, and takes what an initial state lacks to be zero.
"""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd

from olne_bench.envs.tracks.fronts import centred, travel
from olne_bench.envs.tracks.road import (
    MOST_MAP_BYTES,
    UNREADABLE,
    Road,
    RoadLane,
    curves_through,
    read_lanes,
)
from olne_bench.envs.tracks.table import COLUMNS, SLOWEST, Tracks, no_parts, plain_float
from olne_bench.envs.tracks.text import listed, read_xml
from olne_bench.errors import UserError, bad_input

DESCRIPTION = "CommonRoad scenarios (XML); lanes from their lanelets"
#: Elements of obstacles, and those of them that do not move.
_STATIC, _DYNAMIC = ("staticObstacle", "environmentObstacle"), ("dynamicObstacle", "obstacle")
_Row = tuple[float, str, float, float, float, float, float, str, float]


def read(path: Path, part: str | None) -> Tracks:
    """Read the obstacles that have a trajectory; see ``track_formats``."""
    no_parts(part)
    with bad_input(f"{path} is not a CommonRoad scenario in XML", OSError):
        root = read_xml("tracks file", path, MOST_MAP_BYTES, "commonRoad")
        dt = plain_float(root.attrib["timeStepSize"])
        left_out: dict[str, list[str]] = {}
        rows = [row for obstacle in root for row in _rows(obstacle, dt, left_out)]
    if not rows:
        told = "; ".join(f"{why}: {listed(names)}" for why, names in left_out.items())
        raise UserError(f"{path} has no dynamic obstacles{f'; left out, {told}' if told else ''}")
    table = pd.DataFrame(rows, columns=[*COLUMNS, "ahead"])
    ahead = table.pop("ahead")
    if ahead.any():
        table = centred(table, table["heading"].fillna(travel(table)), ahead)
    notes = (f"left out, {why}: {listed(names)}" for why, names in left_out.items())
    return Tracks(table, _road(root), tuple(notes))


def _rows(
    obstacle: ElementTree.Element, dt: float, left_out: dict[str, list[str]]
) -> Iterator[_Row]:
    """The exact states of an element, if it is an obstacle that moves; others are noted."""
    number, role = obstacle.get("id", "?"), obstacle.findtext("role", "").strip()
    if obstacle.tag in _STATIC or (obstacle.tag == "obstacle" and role == "static"):
        left_out.setdefault("static", []).append(number)
    elif obstacle.tag == "phantomObstacle":
        left_out.setdefault("phantoms", []).append(number)
    if obstacle.tag not in _DYNAMIC or role == "static":
        return
    states = obstacle.findall("trajectory/state")
    if not states:
        left_out.setdefault("without a trajectory", []).append(number)
        return
    problems: Counter[str] = Counter()
    for state in [*obstacle.findall("initialState"), *states]:
        try:
            yield _row(obstacle, state, dt)
        except _UncertainError:
            problems["uncertain"] += 1
        except UNREADABLE:
            problems["not readable"] += 1
    for why, count in problems.items():
        left_out.setdefault(why, []).append(f"{count} states of obstacle {number}")


class _UncertainError(Exception):
    """A position or a time is a range."""


def _row(obstacle: ElementTree.Element, state: ElementTree.Element, dt: float) -> _Row:
    point, step = state.find("position/point"), _exact(state, "time")
    if point is None or np.isnan(step):
        raise _UncertainError
    x, y = (plain_float(point.findtext(name, "")) for name in ("x", "y"))
    heading, along, across = (
        _exact(state, name) for name in ("orientation", "velocity", "velocityY")
    )
    speed = along if np.isnan(across) else np.hypot(along, across)
    if np.isnan(heading) and not np.isnan(across) and speed > SLOWEST:
        heading = np.arctan2(across, along)  # of a point mass, whose axes are those of the map
    length, ahead = (
        plain_float(obstacle.findtext(f"shape/rectangle/{name}", default))
        for name, default in (("length", "nan"), ("originXShift", "0"))
    )
    kind = obstacle.findtext("type", "").strip()
    return dt * step, obstacle.attrib["id"], x, y, float(heading), float(speed), length, kind, ahead


def _exact(state: ElementTree.Element, name: str) -> float:
    """An exact value; NaN if there is none, or a range."""
    return plain_float(state.findtext(f"{name}/exact", "nan"))


def _road(root: ElementTree.Element) -> Road:
    lanelets = {lanelet.attrib["id"]: lanelet for lanelet in root.findall("lanelet")}
    following = {
        name: [after.attrib["ref"] for after in lanelet.findall("successor")]
        for name, lanelet in lanelets.items()
    }
    return read_lanes(following, lambda name: _lane(lanelets[name]))


def _lane(lanelet: ElementTree.Element) -> RoadLane:
    left, right = (
        np.array(
            [
                [plain_float(point.findtext(name, "")) for name in ("x", "y")]  # without z
                for point in lanelet.findall(f"{side}/point")
            ]
        )
        for side in ("leftBound", "rightBound")
    )
    if len(left) != len(right):
        raise ValueError(f"its borders have {len(left)} and {len(right)} points")
    width = np.linalg.norm(left - right, axis=1).mean()
    return RoadLane(curves_through((left + right) / 2), float(width))
