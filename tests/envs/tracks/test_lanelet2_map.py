"""Lanes of lanelet2 maps: geometry, directions, successors, and what is refused."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
from pyproj import Proj

from olne_bench.envs.tracks.explained import explain
from olne_bench.envs.tracks.grid import Excerpt
from olne_bench.envs.tracks.lanelet2_map import read_lanelets
from olne_bench.envs.tracks.reading import Imported, read_tracks
from olne_bench.errors import UserError

TRACKS = Path(__file__).parents[3] / "examples" / "tracks"
MAP = TRACKS / "interaction.osm"
Line = Sequence[tuple[float, float]]


def osm(lanelets: Mapping[str, tuple[Line, Line]], **tags: Mapping[str, str]) -> str:
    """A map with separate ways for each lanelet, in local metres."""
    parts = ["<osm>"]
    for name, sides in lanelets.items():
        for side, line in zip(("left", "right"), sides, strict=True):
            for k, (x, y) in enumerate(line):
                parts.append(
                    f'<node id="{name}{side}{k}"><tag k="local_x" v="{x}"/>'
                    f'<tag k="local_y" v="{y}"/></node>'
                )
            refs = "".join(f'<nd ref="{name}{side}{k}"/>' for k in range(len(line)))
            parts.append(f'<way id="{name}{side}">{refs}</way>')
        known = {"type": "lanelet", **tags.get(name, {})}
        parts += [
            f'<relation id="{name}">',
            *(f'<member type="way" ref="{name}{s}" role="{s}"/>' for s in ("left", "right")),
            *(f'<tag k="{key}" v="{value}"/>' for key, value in known.items()),
            "</relation>",
        ]
    return "".join([*parts, "</osm>"])


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "map.osm"


@pytest.mark.parametrize("turned", [(1, 1), (-1, 1), (1, -1), (-1, -1)])
def test_cars_drive_with_the_left_border_to_their_left(path: Path, turned: tuple[int, int]) -> None:
    left, right = [(0.0, 3.0), (4.0, 3.0), (9.0, 3.0)], [(0.0, 0.0), (9.0, 0.0)]
    path.write_text(osm({"a": (left[:: turned[0]], right[:: turned[1]])}))
    lane = read_lanelets(path).lanes["a"]
    np.testing.assert_allclose(lane.line, [[0, 1.5], [9, 1.5]], atol=1e-9)
    assert lane.width == pytest.approx(3)
    path.write_text(osm({"a": (right, left)}))
    np.testing.assert_allclose(read_lanelets(path).lanes["a"].line[[0, -1]], [[9, 1.5], [0, 1.5]])


def test_a_bend_lies_in_the_middle_of_its_borders(path: Path) -> None:
    def arc(radius: float, count: int) -> list[tuple[float, float]]:
        phase = np.linspace(0, np.pi / 2, count)
        return [(1e5 + radius * np.cos(p), radius * np.sin(p)) for p in phase]

    path.write_text(osm({"bend": (arc(20, 40), arc(24, 30)[::-1])}))
    lane = read_lanelets(path).lanes["bend"]
    np.testing.assert_allclose(np.linalg.norm(lane.line - [1e5, 0], axis=1), 22, atol=0.02)
    np.testing.assert_allclose(lane.line[[0, -1]], [[1e5 + 22, 0], [1e5, 22]], atol=1e-9)
    assert lane.width == pytest.approx(4, abs=0.01)


def test_lanes_lead_to_those_that_start_where_both_borders_end(path: Path) -> None:
    start = [(0.0, 3.0), (9.0, 3.0)], [(0.0, 0.0), (9.0, 0.0)]
    ahead = [(9.0, 3.03), (20.0, 3.0)], [(20.0, 0.0), (9.0, 0.0)]
    aside = [(9.0, 3.0), (20.0, 8.0)], [(9.0, 0.0), (20.0, 5.0)]
    beside = [(9.0, 6.0), (20.0, 6.0)], [(9.0, 3.0), (20.0, 3.0)]
    away = [(9.1, 3.0), (20.0, 3.0)], [(9.1, 0.0), (20.0, 0.0)]
    lanelets = {"a": start, "b": ahead, "c": aside, "d": beside, "e": away}
    path.write_text(osm(lanelets, e={"one_way": "no"}))
    following = {name: lane.following for name, lane in read_lanelets(path).lanes.items()}
    assert following == {"a": ("b", "c"), "b": (), "c": (), "d": (), "e": (), "e_back": ()}
    lane = read_lanelets(path).lanes["e_back"]
    np.testing.assert_allclose(lane.line[[0, -1]], [[20, 1.5], [9.1, 1.5]])
    assert lane.width == pytest.approx(3)


def test_only_lanelets_for_cars_are_read(path: Path) -> None:
    sides = [(0.0, 3.0), (9.0, 3.0)], [(0.0, 0.0), (9.0, 0.0)]
    kinds = ("road", "highway", "walkway", "crosswalk", "bicycle_lane")
    text = osm(
        {"plain": sides, "area": sides, **dict.fromkeys(kinds, sides)},
        area={"type": "multipolygon"},
        **{kind: {"subtype": kind} for kind in kinds},
    )
    path.write_text(
        text.replace('<relation id="highway"', '<relation action="delete" id="highway"')
    )
    assert list(read_lanelets(path).lanes) == ["plain", "road"]
    path.write_text(text.replace('"lanelet"', '"area"'))
    with pytest.raises(
        UserError, match="is not a lanelet2 map: none of its 0 lanelets is for cars"
    ):
        read_lanelets(path)


def in_degrees(path: Path, zone: int, origin: tuple[float, float] | None) -> None:
    """The example's map without its local tags, in latitudes and longitudes from an origin."""
    utm = Proj(proj="utm", zone=zone, ellps="WGS84")
    east, north = utm(0, 0) if origin is None else origin
    text = MAP.read_text()
    for k, y in enumerate((-4, -2, 2, 6, 10, 14)):
        for end, x in ((1, 0), (2, 1000)):
            longitude, latitude = utm(east + x, north + y, inverse=True)
            old = text[text.index(f'<node id="{10 * k + end}"') :].partition(">")[0]
            new = f'<node id="{10 * k + end}" lat="{latitude:.10f}" lon="{longitude:.10f}"'
            text = text.replace(old, new)
    path.write_text("\n".join(row for row in text.splitlines() if "local_" not in row))


def lines(imported: Imported) -> dict[str, np.ndarray]:
    road = imported.recording.metadata.episodes[0].road
    assert road is not None
    return {name: entry.lane().line for name, entry in road.lanes.items()}


def test_degrees_are_metres_from_the_origin_of_the_data_set(path: Path, tmp_path: Path) -> None:
    expected = lines(read_tracks(TRACKS / "interaction.csv", "interaction", road=MAP, part="1"))
    in_degrees(path, 31, None)
    found = lines(read_tracks(TRACKS / "interaction.csv", "interaction", road=path, part="1"))
    origin = (293487.1224, 5629711.58)
    tracks = tmp_path / "01_tracks.csv"
    tracks.write_bytes((TRACKS / "ind_tracks.csv").read_bytes())
    meta = tmp_path / "01_recordingMeta.csv"
    meta.write_text("frameRate,xUtmOrigin,yUtmOrigin\n10,293487.1224,5629711.58\n")
    german = tmp_path / "german.osm"
    in_degrees(german, 32, origin)
    located = lines(read_tracks(tracks, "ind", road=german))
    for name, line in expected.items():
        np.testing.assert_allclose(found[name], line, atol=1e-3)
        np.testing.assert_allclose(located[name], line, atol=1e-3)
    meta.write_text("frameRate\n10\n")
    with pytest.raises(UserError, match="none of its 4 lanes comes within 30 m of a player; lanes"):
        read_tracks(tracks, "ind", road=german)


def test_the_shipped_degrees_and_local_metres_agree(path: Path) -> None:
    rows = MAP.read_text().splitlines()
    path.write_text("\n".join(row for row in rows if "local_" not in row))
    local, degrees = read_lanelets(MAP).lanes, read_lanelets(path).lanes
    assert list(local) == list(degrees) == ["201", "202", "203", "204"]
    for name, lane in local.items():
        np.testing.assert_allclose(degrees[name].line, lane.line, atol=1e-3)


def test_degrees_without_pyproj_say_what_to_install(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_degrees(path, 31, None)
    monkeypatch.setitem(sys.modules, "pyproj", None)
    with pytest.raises(UserError, match=r"needs pyproj: pip install 'olne-bench\[lanelet2\]'"):
        read_lanelets(path)
    assert len(read_lanelets(MAP).lanes) == 4


def test_a_map_means_what_the_same_road_file_means(tmp_path: Path) -> None:
    toml = tmp_path / "road.toml"
    toml.write_text(
        "".join(
            f"[lanes.{name}]\npoints = [[0, {y}], [1000, {y}]]\nwidth = 4\n"
            for name, y in (("201", 0), ("202", 4), ("203", 8), ("204", 12))
        )
    )
    by_road = [
        read_tracks(
            TRACKS / "interaction.csv",
            "interaction",
            road=road,
            part="1",
            excerpt=Excerpt(step=0.4),
        )
        for road in (MAP, toml)
    ]
    roads = [known.recording.metadata.episodes[0].road for known in by_road]
    of_map, of_file = (road.road() if road else None for road in roads)
    assert of_map is not None and of_map == of_file
    told, other = (explain("highway", None, known.recording, 0).assumptions for known in by_road)
    assert told == other


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0)])
def test_a_border_may_be_several_ways_in_a_row(path: Path, order: Sequence[int]) -> None:
    left = [(0.0, 3.0), (4.0, 3.0), (7.0, 3.0), (9.0, 3.0)]
    text = osm({"a": (left, [(0.0, 0.0), (9.0, 0.0)])})
    refs = [f'<nd ref="aleft{k}"/>' for k in range(4)]
    pieces = refs[1] + refs[0], refs[1] + refs[2], refs[3] + refs[2]
    ways = "".join(f'<way id="{k}">{piece}</way>' for k, piece in enumerate(pieces))
    members = "".join(f'<member type="way" ref="{k}" role="left"/>' for k in order)
    text = text.replace("<osm>", "<osm>" + ways)
    whole = '<member type="way" ref="aleft" role="left"/>'
    path.write_text(text.replace(whole, members))
    np.testing.assert_allclose(read_lanelets(path).lanes["a"].line, [[0, 1.5], [9, 1.5]])
    path.write_text(text.replace(whole, members.replace('ref="1"', 'ref="0"')))
    with pytest.raises(UserError, match=r"lanelet a: its left way \d does not meet the one before"):
        read_lanelets(path)


ROAD = [(0.0, 3.0), (9.0, 3.0)], [(0.0, 0.0), (9.0, 0.0)]
BROKEN = {
    "no XML": ("lanes", "lanelets", "is not a lanelet2 map: syntax error"),
    "other root": ("osm>", "net>", "its root is <net>, not <osm>"),
    "no way": ('<way id="aleft"', '<way id="other"', "lanelet a names way aleft, which is not"),
    "no node": ('<node id="aleft1"', '<node id="x"', "way aleft names node aleft1, which is not"),
    "no side": ('role="left"', 'role="l"', "lanelet a has no left way"),
    "one node": ('<nd ref="aleft1"/>', "", "way aleft has fewer than 2 nodes"),
    "no place": ('k="local_x"', 'k="x"', "node aleft0 has no lon"),
    "no number": ('v="9.0"', 'v="nine"', "node aleft1: could not convert string to float: 'nine'"),
    "infinite": ('v="9.0"', 'v="inf"', "node aleft1 is at inf, 3, expected numbers below 1e+09"),
    "one border": (
        'ref="aright" role',
        'ref="aleft" role',
        "lane 'a': it has no area between its borders",
    ),
    "a point": ('v="9.0"', 'v="0.0"', "a border has no length"),
    "no id": ('<way id="aleft"', "<way", "it has no 'id'"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_broken_maps_are_refused_in_one_line(case: str, path: Path) -> None:
    old, new, words = BROKEN[case]
    path.write_text("lanes" if case == "no XML" else osm({"a": ROAD}).replace(old, new))
    with pytest.raises(UserError) as caught:
        read_lanelets(path)
    assert words in str(caught.value) and str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_degrees_far_from_everything_and_missing_files_are_refused(path: Path) -> None:
    with pytest.raises(UserError, match="no road file"):
        read_lanelets(path)
    in_degrees(path, 31, None)
    first = path.read_text().partition('lon="')[2].partition('"')[0]
    path.write_text(path.read_text().replace(f'lon="{first}"', 'lon="90"'))
    with pytest.raises(UserError, match="longitudes and latitudes are far from UTM zone 31"):
        read_lanelets(path)


def test_a_map_without_a_lane_near_anybody_is_refused(tmp_path: Path) -> None:
    net = tmp_path / "foot.net.xml"
    net.write_text("<net/>")
    far = tmp_path / "far.osm"
    far.write_text(osm({"a": ([(0.0, 203.0), (9.0, 203.0)], [(0.0, 200.0), (9.0, 200.0)])}))
    for road, words in (
        (net, "none of its 0 lanes comes within 30 m of a player; lanes are nowhere, players are"),
        (
            far,
            "1 lanes comes within 30 m of a player; lanes are at x from 0 to 9, y from 202 to 202",
        ),
    ):
        with pytest.raises(UserError, match=words):
            read_tracks(TRACKS / "interaction.csv", "interaction", road=road, part="1")
