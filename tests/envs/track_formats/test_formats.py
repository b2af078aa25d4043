"""All formats give the same motion in metres, seconds and radians; broken files are refused."""

import re
import shutil
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from olne_bench.envs.track_formats import format_names, get_format
from olne_bench.envs.track_formats.sumo import read_net
from olne_bench.envs.tracks.explained import explain
from olne_bench.envs.tracks.grid import Excerpt
from olne_bench.envs.tracks.reading import Imported, read_tracks
from olne_bench.envs.tracks.table import (
    SLOWEST,
    choose_part,
    companion,
    direction,
    frame_rate,
    listed,
    numbers,
    player_names,
    read_columns,
)
from olne_bench.errors import UserError

ROOT = Path(__file__).parents[3]
TRACKS = ROOT / "examples" / "tracks"
#: File, part and road file of each format, and the names of its lanes from left to right.
FILES = {
    "csv": ("highway.csv", None, "highway.toml", ["0_1_0", "0_1_1", "0_1_2", "0_1_3"]),
    "highd": ("highd_tracks.csv", None, None, ["lower_1", "lower_2", "lower_3", "lower_4"]),
    "ind": ("ind_tracks.csv", None, None, None),
    "ngsim": ("ngsim.csv", None, None, ["lane_1", "lane_2", "lane_3", "lane_4"]),
    "interaction": ("interaction.csv", "1", "interaction.osm", ["201", "202", "203", "204"]),
    "sumo": ("sumo_fcd.xml", None, "sumo.net.xml", ["road_3", "road_2", "road_1", "road_0"]),
    "commonroad": ("commonroad.xml", None, None, ["6", "7", "8", "9"]),
}
WITHOUT_HEADING = ("ngsim",)
SEEN_LATE = ("highd", "ind", "ngsim", "interaction", "sumo")


def example(name: str, step: float | None = 0.4) -> Imported:
    file, part, road, _ = FILES[name]
    return read_tracks(
        TRACKS / file,
        name,
        part=part,
        road=TRACKS / road if road else None,
        excerpt=Excerpt(step=step),
    )


def test_every_format_has_an_example() -> None:
    assert sorted(FILES) == format_names()
    assert all(get_format(name).DESCRIPTION for name in FILES)
    with pytest.raises(UserError, match="unknown format 'nope'; known are: commonroad, csv"):
        get_format("nope")


@pytest.mark.parametrize("name", FILES)
def test_all_formats_tell_of_one_motion(name: str) -> None:
    states = example(name).recording.states[0]
    truth = example("csv").recording.states[0].copy()
    if name in SEEN_LATE:
        truth[:2, -1] = np.nan
    if name in WITHOUT_HEADING:
        truth[..., 2] = np.nan
    np.testing.assert_allclose(states, truth, atol=2e-6)


@pytest.mark.parametrize("name", [name for name in FILES if FILES[name][3]])
def test_lanes_are_where_the_format_says(name: str) -> None:
    known = example(name).recording
    road = known.metadata.episodes[0].road
    assert road is not None
    lines = {lane: entry.lane().line for lane, entry in road.lanes.items()}
    names = FILES[name][3]
    assert names is not None and sorted(lines) == sorted(names)
    for lane, y in zip(names, (0.0, 4.0, 8.0, 12.0), strict=True):
        # In NGSIM, lanes are where cars drove; half of the cars changed lanes.
        np.testing.assert_allclose(lines[lane][:, 1], y, atol=1.5 if name == "ngsim" else 1e-9)
        assert lines[lane][-1, 0] > lines[lane][0, 0] + 200
    driven = [a.value for a in explain("highway", None, known, 0).assumptions if a.what == "lanes"]
    # The road file of the plain table names the lanes; those of all others are matched by position.
    assert driven == [names[k] for k in (3, 0, 2, 1, 3)]


def test_the_data_of_one_case_or_place_are_chosen(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="holds 1, 2 in case_id; choose one with --part"):
        read_tracks(TRACKS / "interaction.csv", "interaction")
    with pytest.raises(UserError, match=r"--part '3': case_id of .* holds 1, 2"):
        read_tracks(TRACKS / "interaction.csv", "interaction", part="3")
    table = pd.read_csv(TRACKS / "ngsim.csv")
    path = tmp_path / "both.csv"
    pd.concat([table.assign(Location="us-101"), table.assign(Location="i-80")]).to_csv(path)
    with pytest.raises(UserError, match="holds us-101, i-80 in Location"):
        read_tracks(path, "ngsim")
    chosen = read_tracks(path, "ngsim", part="i-80").recording
    np.testing.assert_array_equal(chosen.states[0], example("ngsim", None).recording.states[0])
    for name in ("csv", "highd", "ind", "sumo", "commonroad"):
        with pytest.raises(UserError, match="--part 'x': "):
            read_tracks(TRACKS / FILES[name][0], name, part="x")


def test_the_text_files_of_ngsim_have_no_header(tmp_path: Path) -> None:
    table = pd.read_csv(TRACKS / "ngsim.csv")
    order = (
        *("Vehicle_ID", "Frame_ID", "Total", "Global_Time", "Local_X", "Local_Y", "GX", "GY"),
        *("v_Length", "v_Width", "v_Class", "v_Vel", "v_Acc", "Lane_ID", "a", "b", "c", "d"),
    )
    path = tmp_path / "trajectories.txt"
    full = table.reindex(columns=list(order)).fillna(0)
    full.to_csv(path, sep=" ", header=False, index=False)
    states = read_tracks(path, "ngsim").recording.states[0]
    np.testing.assert_allclose(states, example("ngsim", None).recording.states[0])


def test_a_data_set_needs_the_data_of_its_recording(tmp_path: Path) -> None:
    for name in ("highd", "ind"):
        path = tmp_path / f"{name}_tracks.csv"
        shutil.copy(TRACKS / path.name, path)
        with pytest.raises(UserError, match=f"frame rate is in '{name}_recordingMeta.csv', which"):
            read_tracks(path, name)
        path.with_name(f"{name}_recordingMeta.csv").write_text("frameRate\n0\n")
        with pytest.raises(UserError, match=r"frameRate is 0, expected 0\.1 to 10000 per second"):
            read_tracks(path, name)


BROKEN = {
    "highd": ("a,b\n1,2\n", "missing columns id, frame, x, y, width, height, xVelocity"),
    "ind": ("trackId\n1\n", "missing columns frame, xCenter"),
    "ngsim": ("", "is empty; expected the columns Vehicle_ID, Frame_ID, Local_X"),
    "interaction": (
        "track_id,timestamp_ms,x,y,vx,vy\n1,0,a,0,0,0\n",
        "row 1: x is 'a', expected a finite number",
    ),
    "sumo": ("<fcd-export><timestep time='0'><vehicle id='a' x='0'/>", "not floating car data"),
    "commonroad": ("<commonRoad/>", "is not a CommonRoad scenario"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_broken_files_are_refused(name: str, tmp_path: Path) -> None:
    text, words = BROKEN[name]
    path = tmp_path / ("file.xml" if name in ("sumo", "commonroad") else "file.csv")
    path.write_text(text)
    with pytest.raises(UserError, match=words):
        read_tracks(path, name)
    with pytest.raises(UserError, match="no tracks file"):
        read_tracks(tmp_path / "none.xml", name)


def test_broken_networks_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "road.xml"
    source = TRACKS / "sumo_fcd.xml"
    for text, words in (
        ("<net", "is not a SUMO network"),
        ("<other/>", "its root is <other>, not <net>"),
        (
            '<net><edge><lane id="a"/></edge></net>',
            "is not a SUMO network: lane 'a': it has no 'shape'",
        ),
    ):
        path.write_text(text)
        with pytest.raises(UserError, match=words):
            read_tracks(source, "sumo", road=path)


def test_networks_lead_through_junctions_and_leave_out_footpaths(tmp_path: Path) -> None:
    path = tmp_path / "road.net.xml"
    path.write_text(
        '<net><edge id="a"><lane id="a_0" shape="0,0 9,0"/>'
        '<lane id="a_1" allow="pedestrian" shape="0,3 9,3"/></edge>'
        '<edge id=":j" function="internal"><lane id=":j_0" shape="9,0 12,1"/></edge>'
        '<edge id=":w" function="walkingarea"><lane id=":w_0" shape="9,0 12,1"/></edge>'
        '<edge id="b"><lane id="b_0" width="2.5" shape="12,1 20,1"/></edge>'
        '<connection from="a" to="b" fromLane="0" toLane="0" via=":j_0"/>'
        '<connection from=":j" to="b" fromLane="0" toLane="0"/></net>'
    )
    lanes = read_net(path).lanes
    assert {name: lane.following for name, lane in lanes.items()} == {
        "a_0": (":j_0",),
        ":j_0": ("b_0",),
        "b_0": (),
    }
    assert (lanes["a_0"].width, lanes["b_0"].width) == (3.2, 2.5)


def test_the_script_writes_the_examples(tmp_path: Path) -> None:
    spec = spec_from_file_location("example_tracks", ROOT / "scripts" / "example_tracks.py")
    assert spec is not None and spec.loader is not None
    script = module_from_spec(spec)
    sys.modules[spec.name] = script
    spec.loader.exec_module(script)
    for name in ("highway.csv", "highway.toml"):
        shutil.copy(TRACKS / name, tmp_path / name)
    script.write_all(tmp_path)
    by_hand = {"no_targets.toml"}
    written = {path.name for path in tmp_path.iterdir()}
    assert written | by_hand == {path.name for path in TRACKS.iterdir()}
    for path in tmp_path.iterdir():
        if path.name == "commonroad.xml":  # it holds the date
            states = read_tracks(path, "commonroad").recording.states[0]
            np.testing.assert_array_equal(states, example("commonroad", None).recording.states[0])
        else:
            assert path.read_text() == (TRACKS / path.name).read_text()


@pytest.mark.parametrize(("number", "more"), [(1, 0), (7, 0), (8, 0), (9, 1), (30, 22)])
def test_many_names_are_told_by_the_first_of_them(number: int, more: int) -> None:
    names = [f"n{k}" for k in range(number)]
    shown, _, rest = listed(names).partition(" and ")
    assert shown.split(", ") == names[: number - more]
    assert rest == (f"{more} more" if more else "")


def test_a_part_is_chosen_where_there_are_several() -> None:
    frame = pd.DataFrame({"case": [1.0, 1.0, 2.0], "x": [1, 2, 3]})
    path = Path("tracks.csv")
    assert choose_part(path, frame, "case", "1")["x"].tolist() == [1, 2]
    assert choose_part(path, frame, "case", "2")["x"].tolist() == [3]
    assert choose_part(path, frame[:2], "case", None)["x"].tolist() == [1, 2]
    assert choose_part(path, frame, "other", None) is frame
    with pytest.raises(UserError, match=r"--part .1.: tracks\.csv has no column other"):
        choose_part(path, frame, "other", "1")


def test_names_of_players_are_texts_without_decimals() -> None:
    assert player_names(pd.Series([1.0, 2.5, 3.0])).tolist() == ["1", "2.5", "3"]
    assert player_names(pd.Series([" a ", "1.0"])).tolist() == ["a", "1.0"]


def test_who_hardly_moves_has_no_direction() -> None:
    vx = pd.Series([SLOWEST * 0.99, SLOWEST * 1.01, 0.0, -3.0, 0.08])
    vy = pd.Series([0.0, 0.0, 2.0, 0.0, 0.08])
    expected = [np.nan, 0.0, np.pi / 2, np.pi, np.pi / 4]
    np.testing.assert_allclose(direction(vx, vy), expected)


def test_numbers_are_finite_and_what_is_none_is_placed() -> None:
    frame = pd.DataFrame({"a": ["1", "2.5", None], "b": ["x", "y", "z"]})
    found = numbers(Path("t.csv"), frame, ["a"])
    np.testing.assert_array_equal(found["a"], [1, 2.5, np.nan])
    assert found["b"].tolist() == ["x", "y", "z"]
    assert frame["a"].iloc[0] == "1"  # the caller's frame stays as it was
    for row, wrong in ((0, "x"), (2, "inf")):
        texts = ["1", "2", "3"]
        texts[row] = wrong
        with pytest.raises(UserError, match=f"t.csv, row {row + 1}: a is '{wrong}', expected a"):
            numbers(Path("t.csv"), pd.DataFrame({"a": texts}), ["a"])


@pytest.mark.parametrize("rate", ["0", "-25", "1e-300", "1e300"])
def test_a_frame_rate_is_that_of_a_camera(rate: str) -> None:
    assert frame_rate(pd.DataFrame({"frameRate": ["25"]}), Path("m.csv")) == 25.0
    with pytest.raises(
        UserError, match=f"{re.escape(f'frameRate is {float(rate):g}')}, expected 0.1 to 10000 per"
    ):
        frame_rate(pd.DataFrame({"frameRate": [rate]}), Path("m.csv"))


def test_columns_are_found_whatever_their_case(tmp_path: Path) -> None:
    path = tmp_path / "01_tracks.csv"
    path.write_text(" Frame,ID ,Speed\n1,2,3\n")
    frame = read_columns(path, ["frame", "id"], ["speed", "width"])
    assert list(frame.columns) == ["frame", "id", "speed"]
    for needed, said in ((["x"], "missing column x; it"), (["x", "y"], "missing columns x, y;")):
        with pytest.raises(UserError, match=said):
            read_columns(path, needed)
    assert companion(path, "map") is None
    (tmp_path / "01_map.csv").touch()
    assert companion(path, "map") == tmp_path / "01_map.csv"
