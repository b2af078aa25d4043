"""Lanes of a lanelet2 map (``.osm``, ``.osm_xy``), as INTERACTION, inD and rounD have them."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.spatial import KDTree

from olne_bench.envs.tracks.road import (
    FARTHEST,
    MOST_MAP_BYTES,
    Road,
    RoadLane,
    curves_through,
    left_out,
    read_lanes,
    with_lanes,
)
from olne_bench.envs.tracks.table import plain_float
from olne_bench.envs.tracks.text import read_xml
from olne_bench.errors import UserError, bad_input

FOR_CARS = ("road", "highway")  # subtypes; a lanelet without one is a road
MEET = 0.05  # [m], largest distance between the ends of two borders that meet
_DIGITS = 4  # of fractions of a border's length: points that round to the same are merged

_Borders = tuple[np.ndarray, np.ndarray]


def read_lanelets(path: Path, origin: tuple[float, float] | None = None) -> Road:
    """Read the lanelets for cars that can be read, and their successors.

    A two-way lanelet becomes two lanes. ``origin`` is UTM east and north [m] of (0, 0) in the
    tracks; by default the point at latitude 0 and longitude 0, as in INTERACTION. It is unused if
    nodes have ``x`` and ``y``, or all nodes of borders have the tags ``local_x`` and ``local_y``.
    """
    with bad_input(f"{path} is not a lanelet2 map", OSError):
        root = read_xml("road file", path, MOST_MAP_BYTES, "osm")
        borders, wrong = _borders(root, origin)
        road = read_lanes(_following(borders) if borders else {}, lambda name: _lane(borders[name]))
        return with_lanes(replace(road, notes=(*left_out(wrong), *road.notes)))


def _borders(
    root: ElementTree.Element, origin: tuple[float, float] | None
) -> tuple[dict[str, _Borders], list[str]]:
    """Points of both borders of each lane, left first, in driving direction, and what is wrong."""
    relations = _by_id(root, "relation")
    tags = {name: _tags(relation) for name, relation in relations.items()}
    lanelets = [name for name in relations if tags[name].get("type") == "lanelet"]
    chosen = [name for name in lanelets if tags[name].get("subtype", "road") in FOR_CARS]
    if not chosen:
        raise ValueError(f"none of its {len(lanelets)} lanelets is for cars")
    nodes, ways = _by_id(root, "node"), _by_id(root, "way")
    sides, wrong = {}, []
    for name in chosen:
        try:
            sides[name] = [
                _side(name, relations[name], side, ways, nodes) for side in ("left", "right")
            ]
        except ValueError as error:
            wrong.append(str(error))
    used = dict.fromkeys(ref for pair in sides.values() for refs in pair for ref in refs)
    points, nowhere = _points({ref: nodes[ref] for ref in used}, origin)
    result: dict[str, _Borders] = {}
    for name, pair in sides.items():
        lost = [ref for refs in pair for ref in refs if ref in nowhere]
        if lost:
            wrong.append(f"lanelet {name}: {nowhere[lost[0]]}")
            continue
        left, right = _aligned(*(np.array([points[ref] for ref in refs]) for refs in pair))
        result[name] = left, right
        if tags[name].get("one_way") == "no":
            result[f"{name}_back"] = right[::-1], left[::-1]
    return result, wrong


def _by_id(root: ElementTree.Element, kind: str) -> dict[str, ElementTree.Element]:
    """Elements of a kind, without those that an editor marked as deleted."""
    kept = (element for element in root.iter(kind) if element.get("action") != "delete")
    return {element.attrib["id"]: element for element in kept}


def _tags(element: ElementTree.Element) -> dict[str, str]:
    return {tag.attrib["k"]: tag.attrib["v"] for tag in element.findall("tag")}


def _side(
    name: str,
    relation: ElementTree.Element,
    side: str,
    ways: Mapping[str, ElementTree.Element],
    nodes: Mapping[str, ElementTree.Element],
) -> list[str]:
    """Ids of the nodes of a lanelet's left or right border: one way, or several in a row."""
    line: list[str] = []
    for way in (m.attrib["ref"] for m in relation.findall("member") if m.get("role") == side):
        if way not in ways:
            raise ValueError(f"lanelet {name} names way {way}, which is not there")
        refs = [node.attrib["ref"] for node in ways[way].findall("nd")]
        for ref in refs:
            if ref not in nodes:
                raise ValueError(f"way {way} names node {ref}, which is not there")
        if len(set(refs)) < 2:
            raise ValueError(f"way {way} has fewer than 2 nodes")
        joined = _joined(line, refs) if line else refs
        if joined is None:
            raise ValueError(f"lanelet {name}: its {side} way {way} does not meet the one before")
        line = joined
    if not line:
        raise ValueError(f"lanelet {name} has no {side} way")
    return line


def _joined(line: list[str], refs: list[str]) -> list[str] | None:
    """Two ways joined at a shared end, in any direction; None if they share none."""
    for first in (line, line[::-1]):
        for second in (refs, refs[::-1]):
            if first[-1] == second[0]:
                return first + second[1:]
    return None


def _points(
    nodes: Mapping[str, ElementTree.Element], origin: tuple[float, float] | None
) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Positions [m] of nodes in the frame of the tracks, and what is wrong with nodes without."""
    known = {ref: {**node.attrib, **_tags(node)} for ref, node in nodes.items()}
    frames = ("x", "y"), ("local_x", "local_y"), ("lon", "lat")
    names = next(
        (n for n in frames if all(set(n) <= set(one) for one in known.values())), frames[2]
    )
    places, wrong = {}, {}
    for ref, one in known.items():
        try:
            places[ref] = _pair(ref, one, names)
        except (ValueError, UserError) as error:
            wrong[ref] = str(error)
    if places and names == frames[2]:
        metres = _projected(np.array(list(places.values())), origin)
        return dict(zip(places, metres, strict=True)), wrong
    return places, wrong


def _pair(ref: str, known: Mapping[str, str], names: tuple[str, str]) -> np.ndarray:
    absent = [name for name in names if name not in known]
    if absent:
        raise ValueError(f"node {ref} has no {absent[0]}")
    with bad_input(f"node {ref}"):
        pair = np.array([plain_float(known[name]) for name in names])
    if not (np.abs(pair) < FARTHEST).all():
        raise ValueError(
            f"node {ref} is at {pair[0]:g}, {pair[1]:g}, expected numbers below {FARTHEST:g}"
        )
    return pair


def _projected(degrees: np.ndarray, origin: tuple[float, float] | None) -> np.ndarray:
    """Longitudes and latitudes (P, 2) as metres from the origin."""
    try:
        from pyproj import Proj
    except ImportError as error:
        raise UserError(
            "a map whose nodes have no local_x and local_y needs pyproj: "
            "pip install 'olne-bench[lanelet2]'"
        ) from error
    longitude, latitude = (0.0, 0.0) if origin is None else degrees.mean(axis=0)
    zone = int((longitude + 180) // 6) % 60 + 1
    utm = Proj(proj="utm", zone=zone, south=bool(latitude < 0), ellps="WGS84")
    metres = np.column_stack(utm(*degrees.T))
    if not np.isfinite(metres).all():
        raise ValueError(f"its longitudes and latitudes are far from UTM zone {zone}")
    return np.asarray(metres - np.array(utm(0.0, 0.0) if origin is None else origin))


def _aligned(left: np.ndarray, right: np.ndarray) -> _Borders:
    """Both borders in driving direction, such that the left one is to the left."""
    alike = np.linalg.norm(left[[0, -1]] - right[[0, -1]], axis=1).sum()
    against = np.linalg.norm(left[[0, -1]] - right[[-1, 0]], axis=1).sum()
    if against < alike:
        right = right[::-1]
    if _area(left, right) < 0:
        left, right = left[::-1], right[::-1]
    return left, right


def _area(left: np.ndarray, right: np.ndarray) -> float:
    """Area between the borders [m²], positive if the right one is to the right."""
    ring = np.concatenate([right, left[::-1]])
    x, y = (ring - ring[0]).T  # relative to a near origin, to keep digits
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def _lane(borders: _Borders) -> RoadLane:
    fractions, area = [_fractions(border) for border in borders], _area(*borders)
    at = np.unique(np.round(np.concatenate(fractions), _DIGITS))
    centre = np.mean([_at(border, at) for border in borders], axis=0)
    length = np.linalg.norm(np.diff(centre, axis=0), axis=1).sum()
    if not (length > 0 and area > 0):
        raise ValueError("it has no area between its borders")
    return RoadLane(curves_through(centre), float(area / length))


def _fractions(line: np.ndarray) -> np.ndarray:
    """Share of a line's length before each of its points (P,), from 0 to 1."""
    along = np.cumsum(np.r_[0.0, np.linalg.norm(np.diff(line, axis=0), axis=1)])
    if not along[-1] > 0:
        raise ValueError("a border has no length")
    return np.asarray(along / along[-1])


def _at(line: np.ndarray, fractions: np.ndarray) -> np.ndarray:
    known = _fractions(line)
    return np.column_stack([np.interp(fractions, known, values) for values in line.T])


def _following(borders: Mapping[str, _Borders]) -> dict[str, tuple[str, ...]]:
    """Successors of each lane: lanes whose borders start where both of its borders end."""
    names = list(borders)
    starts, ends = (
        np.array([np.r_[left[k], right[k]] for left, right in borders.values()]) for k in (0, -1)
    )
    found: Iterable[list[int]] = KDTree(starts).query_ball_point(ends, MEET, p=np.inf)
    return {
        name: tuple(names[k] for k in sorted(near)) for name, near in zip(names, found, strict=True)
    }
