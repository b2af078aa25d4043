"""Files as people have them: clocks, units, who is in them, and how the text is written."""

import gzip
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from olne_bench.envs.track_formats.sumo import read_net
from olne_bench.envs.tracks.grid import Excerpt
from olne_bench.envs.tracks.lanelet2_map import read_lanelets
from olne_bench.envs.tracks.reading import Imported, read_tracks
from olne_bench.errors import UserError

FOOT = 0.3048


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "tracks.csv"


def plain(times: np.ndarray, speed: float = 25.0, player: str = "a") -> pd.DataFrame:
    return pd.DataFrame({"time": times, "player": player, "x": speed * times, "y": 0.0})


def read(path: Path, table: pd.DataFrame, name: str = "csv", **more: object) -> Imported:
    table.to_csv(path, index=False)
    return read_tracks(path, name, **more)  # type: ignore[arg-type]


def players(imported: Imported) -> list[str]:
    return imported.recording.metadata.episodes[0].players


def states(imported: Imported) -> np.ndarray:
    return imported.recording.states[0]


# -- time


@pytest.mark.parametrize("rate", [10, 15, 23.976, 24, 25, 29.97, 30, 59.94, 60, 120])
@pytest.mark.parametrize("begin", [0.0, 0.4, 1.5e9])
def test_a_rate_in_milliseconds_is_that_rate(path: Path, rate: float, begin: float) -> None:
    exact = np.arange(200) / rate
    table = plain(exact).assign(time=np.round(begin + exact, 3))
    imported = read(path, table)
    found = imported.recording
    assert len(found.times[0]) == 200
    assert found.metadata.dt == pytest.approx(1 / rate, abs=0.001 / 199)
    # A sample is where the car was, within half a millisecond.
    drive = 25 * (found.times[0] - begin)
    np.testing.assert_allclose(states(imported)[:, 0, 0], drive, atol=25 * 0.0011)
    assert imported.notes == ()


def test_times_may_be_rounded_to_a_third_of_a_step(path: Path) -> None:
    exact = np.arange(60) / 30
    found = read(path, plain(exact).assign(time=np.round(exact, 2))).recording
    assert len(found.times[0]) == 60 and np.isfinite(found.states[0][..., 0]).all()


@pytest.mark.parametrize("late", [0.03, 0.05, 0.08])
def test_cars_between_the_steps_of_others_are_not_made_up(path: Path, late: float) -> None:
    times = 0.1 * np.arange(31)
    both = pd.concat([plain(times), plain(times + late, player="b")])
    with pytest.raises(UserError, match=r"unequal time steps.*--resample 0\.1 makes them equal"):
        read(path, both)
    found = states(read(path, both, excerpt=Excerpt(step=0.1)))
    assert np.isfinite(found[1:-1]).all(axis=(0, 1))[:2].all()


def test_a_clock_that_is_a_little_late_is_told(path: Path) -> None:
    times = 0.1 * np.arange(31)
    imported = read(path, pd.concat([plain(times), plain(times + 0.004, player="b")]))
    assert imported.notes[0].startswith("times differ by up to 0.004 s from steps of 0.1")


def test_every_second_sample_is_missing_not_interpolated(path: Path) -> None:
    times = 0.1 * np.arange(31)
    found = states(read(path, pd.concat([plain(times), plain(times[::2], player="b")])))
    np.testing.assert_array_equal(np.isnan(found[:, 1, 0]), np.arange(31) % 2 == 1)


@pytest.mark.parametrize("steps", [19, 20, 21, 100, 500])
@pytest.mark.parametrize("rate", [10, 30])
def test_gaps_of_any_length_keep_the_step(path: Path, steps: int, rate: float) -> None:
    exact = np.r_[np.arange(31), 30 + steps + np.arange(31)] / rate
    imported = read(path, plain(exact).assign(time=np.round(exact, 3)))
    found = imported.recording
    assert len(found.times[0]) == 61 + steps
    assert np.isfinite(found.states[0][:, 0, 0]).sum() == 62
    known = np.isfinite(found.states[0][:, 0, 0])
    drive = 25 * found.times[0][known]
    np.testing.assert_allclose(found.states[0][known, 0, 0], drive, atol=25 * 0.0011)


# -- units


def test_degrees_are_no_metres(path: Path) -> None:
    table = plain(0.1 * np.arange(31), 10.0)
    table["x"], table["y"] = 11.5 + table["x"] / 7e4, 48.1 + table["x"] / 1.1e5
    with pytest.raises(UserError, match=r"change by at most .* per second; .* degrees\?"):
        read(path, table)
    still = table.assign(x=11.5 + np.random.default_rng(0).normal(0, 2e-4, 31), y=48.1)
    assert len(states(read(path, still))) == 31


@pytest.mark.parametrize(("length", "speed", "said"), [(15, 60, 1), (4.5, 30, 0), (1.4, 8, 1)])
def test_lengths_in_feet_are_doubted(path: Path, length: float, speed: float, said: int) -> None:
    table = plain(0.1 * np.arange(31), speed).assign(length=length)
    notes = [note for note in read(path, table).notes if "feet" in note]
    assert len(notes) == said + (speed > 50)
    assert not read(path, table.assign(**{"class": "Truck", "x": table["time"]})).notes


def ngsim(unit: float = FOOT, **more: object) -> pd.DataFrame:
    """Two cars of 4.5 m at 15 m/s, 1.8 and 5.5 m from the left, whose fronts start at 0 and 30."""
    frames = np.arange(31)
    cars = [
        pd.DataFrame(
            {
                **{"Vehicle_ID": number, "Frame_ID": 10 + frames},
                **{"Local_X": y / unit, "Local_Y": (x + 1.5 * frames) / unit},
                **{"v_Length": 4.5 / unit, "v_Width": 1.8 / unit, "v_Vel": 15 / unit},
                "Lane_ID": number,
            }
        )
        for number, x, y in ((1, 0.0, 1.8), (2, 30.0, 5.5))
    ]
    return pd.concat(cars, ignore_index=True).assign(**more)


@pytest.mark.parametrize("unit", [FOOT, 1.0])
@pytest.mark.parametrize("without", [[], ["v_Width"], ["Lane_ID"]])
def test_ngsim_is_read_in_its_own_unit(path: Path, unit: float, without: list[str]) -> None:
    imported = read(path, ngsim(unit).drop(columns=without), "ngsim")
    np.testing.assert_allclose(states(imported)[0, :, :2], [[-2.25, 1.8], [27.75, 5.5]])
    np.testing.assert_allclose(states(imported)[..., 3], 15)
    assert any("in metres" in note for note in imported.notes) == (unit == 1)


def test_motorcycles_in_feet_are_no_cars_in_metres(path: Path) -> None:
    table = ngsim(v_Length=7.0, v_Width=2.5, v_Class=1)
    np.testing.assert_allclose(states(read(path, table, "ngsim"))[..., 3], 15)


def test_a_car_that_drives_south_is_behind_its_front(path: Path) -> None:
    table = ngsim()
    table.loc[table["Vehicle_ID"] == 2, "Local_Y"] *= -1
    imported = read(path, table, "ngsim")
    np.testing.assert_allclose(states(imported)[0, :, 0], [-2.25, -27.75])
    road = imported.recording.metadata.episodes[0].road
    assert road is not None
    ways = {name: np.diff(lane.lane().line[:, 0])[0] for name, lane in road.lanes.items()}
    assert ways["lane_1"] > 0 > ways["lane_2"]


def test_both_carriageways_of_highd_are_driven_and_have_lanes(tmp_path: Path) -> None:
    path = tmp_path / "1_tracks.csv"
    (tmp_path / "1_recordingMeta.csv").write_text(
        "frameRate,upperLaneMarkings,lowerLaneMarkings\n25,4;8;8,20;x;28;32\n"
    )
    frames = np.arange(30)
    cars = [
        {"id": 1, "x": 100 - frames, "y": 5.0, "xVelocity": -25.0},
        {"id": 2, "x": frames, "y": 29.0, "xVelocity": 25.0},
    ]
    table = pd.concat([pd.DataFrame({"frame": frames, **car}) for car in cars])
    imported = read(path, table.assign(width=4.5, height=2.0, yVelocity=0.0), "highd")
    np.testing.assert_allclose(states(imported)[0, :, :2], [[102.25, 6], [2.25, 30]])
    np.testing.assert_allclose(np.cos(states(imported)[0, :, 2]), [-1, 1])
    road = imported.recording.metadata.episodes[0].road
    assert road is not None and list(road.lanes) == ["upper_1", "lower_3"]
    assert np.diff(road.lanes["upper_1"].lane().line[:, 0])[0] < 0
    assert "lane 'upper_2': a lane's width is 0 m" in imported.notes[0]


def test_both_directions_of_one_lane_number_are_two_lanes(path: Path) -> None:
    table = ngsim(Lane_ID=2)
    table.loc[table["Vehicle_ID"] == 2, "Local_Y"] *= -1
    road = read(path, table, "ngsim").recording.metadata.episodes[0].road
    assert road is not None and list(road.lanes) == ["lane_2", "lane_2_back"]


def test_a_car_that_crosses_the_road_is_behind_its_front(path: Path) -> None:
    table = ngsim()
    second = table["Vehicle_ID"] == 2
    table.loc[second, "Local_X"], table.loc[second, "Local_Y"] = table["Local_Y"], 10 / FOOT
    imported = read(path, table, "ngsim")
    np.testing.assert_allclose(states(imported)[0, 1, :2], [10, 27.75], atol=1e-9)
    road = imported.recording.metadata.episodes[0].road
    assert road is not None and list(road.lanes) == ["lane_1"]


def test_who_stands_faces_as_direction_says(path: Path) -> None:
    table = ngsim(Direction=4, Local_X=6.0, v_Vel=0.0)
    table["Local_Y"] = 100 * table["Vehicle_ID"] + np.random.default_rng(0).normal(0, 0.1, 62)
    found = states(read(path, table, "ngsim"))
    np.testing.assert_allclose(found[0, :, 0], FOOT * np.array([100, 200]) + 2.25, atol=0.1)


@pytest.mark.parametrize("speed", [0.4, 3.0])
def test_a_queue_that_creeps_south_is_behind_its_fronts(path: Path, speed: float) -> None:
    frames = np.tile(np.arange(31), 2)
    noise = np.random.default_rng(0).normal(0, 0.02, 62)
    table = ngsim(v_Vel=speed / FOOT)
    table["Local_Y"] = (80 * table["Vehicle_ID"] - 0.1 * speed * frames + noise) / FOOT
    found = states(read(path, table, "ngsim"))
    np.testing.assert_allclose(found[0, :, 0], [82.25, 162.25], atol=0.1)


@pytest.mark.parametrize("missing", [np.nan, -1, 0])
def test_rows_of_no_lane_make_none(path: Path, missing: float) -> None:
    table = ngsim()
    table["Lane_ID"] = table["Lane_ID"].astype(float).where(table["Frame_ID"] > 20, missing)
    road = read(path, table, "ngsim").recording.metadata.episodes[0].road
    assert road is not None and list(road.lanes) == ["lane_1", "lane_2"]


# -- who


def test_an_id_of_a_later_period_is_another_car(path: Path) -> None:
    first, later = ngsim(), ngsim().assign(Frame_ID=lambda t: t["Frame_ID"] + 35)
    first["Global_Time"] = 1118846980200 + 100 * first["Frame_ID"]
    later["Global_Time"] = 1118846980200 + 900_000 + 100 * later["Frame_ID"]
    imported = read(path, pd.concat([first, later]), "ngsim")
    assert players(imported) == ["1", "2", "1#2", "2#2"]
    assert any("another car: 1#2, 2#2" in note for note in imported.notes)
    assert imported.recording.times[0][-1] == pytest.approx(907.5)
    rounded = pd.concat([first, later]).assign(Global_Time=1.11885e12)  # by a spreadsheet
    assert read(path, rounded, "ngsim").recording.times[0][-1] == pytest.approx(7.5)


def test_a_car_that_was_away_for_long_is_another(path: Path) -> None:
    times = 0.1 * np.arange(31)
    again = plain(times).assign(time=times + 3600, x=500 - 25 * times)
    imported = read(path, pd.concat([plain(times), again]))
    assert players(imported) == ["a", "a#2"]
    away = plain(times).assign(time=times + 30, x=plain(times)["x"] + 750)
    assert players(read(path, pd.concat([plain(times), away]))) == ["a"]


def test_rows_that_repeat_are_read_once(path: Path) -> None:
    table = plain(0.1 * np.arange(9))
    imported = read(path, pd.concat([table, table[3:5]]))
    assert imported.notes == ("left out: 2 rows that repeat another",)
    with pytest.raises(UserError, match=r"player 'a' has time 0\.3 twice"):
        read(path, pd.concat([table, table[3:4].assign(x=0)]))


def test_rows_without_a_name_are_left_out(path: Path) -> None:
    table = pd.concat([plain(0.1 * np.arange(9)), plain(0.1 * np.arange(9), player="NaN")])
    imported = read(path, table)
    assert players(imported) == ["a"]
    assert imported.notes == ("left out: 9 rows without a player",)
    cars = ngsim().astype({"Vehicle_ID": float})
    cars.loc[cars["Vehicle_ID"] == 2, "Vehicle_ID"] = np.nan
    assert players(read(path, cars, "ngsim")) == ["1"]


OTHERS = ["pedestrian", "bicycle", "pedestrian/bicycle", "parkedVehicle", "DEFAULT_BIKETYPE", "ped"]


@pytest.mark.parametrize("kind", OTHERS)
def test_who_is_no_vehicle_is_left_out_unless_named(path: Path, kind: str) -> None:
    times = 0.1 * np.arange(9)
    table = pd.concat(
        [
            plain(times).assign(type="motorcycle"),
            plain(times, 1.0, "b").assign(type=kind),
        ]
    )
    imported = read(path, table)
    assert players(imported) == ["a"]
    assert f"left out, no vehicles: b ({kind})" in imported.notes[0]
    assert players(read(path, table, excerpt=Excerpt(players=("b", "a")))) == ["b", "a"]
    with pytest.raises(UserError, match=r"nobody is a vehicle: b \("):
        read(path, table[table["player"] == "b"])


def test_classes_of_highd_and_ind_are_beside_the_tracks(tmp_path: Path) -> None:
    frames = np.tile(np.arange(30), 2)
    number = np.repeat([1, 2], 30)
    motion = {"frame": frames, "xVelocity": 8.0, "yVelocity": 0.0}
    for name, table, column in (
        ("highd", {"id": number, "x": 0.32 * frames, "y": 5.0, "width": 4.5, "height": 2}, "id"),
        (
            "ind",
            {
                **{"trackId": number, "xCenter": 0.32 * frames, "yCenter": 5.0},
                **{"heading": 0.0, "length": 4.5},
            },
            "trackId",
        ),
    ):
        path = tmp_path / f"{name}_tracks.csv"
        (tmp_path / f"{name}_recordingMeta.csv").write_text("frameRate\n25\n")
        full = pd.DataFrame({**table, **motion})
        assert players(read(path, full, name)) == ["1", "2"]
        meta = pd.DataFrame({column: [1, 2], "class": ["pedestrian", "car"]})
        meta.to_csv(tmp_path / f"{name}_tracksMeta.csv", index=False)
        assert players(read(path, full, name)) == ["2"]


# -- text


ROWS = "time,player,x,y\n0,a,0,1.5\n0.1,a,1,1.5\n0.2,a,2,1.5\n"
WRITTEN: dict[str, Callable[[], bytes]] = {
    "mark": lambda: ROWS.encode("utf-8-sig"),
    "UTF-16": lambda: ROWS.encode("utf-16"),
    "CRLF": lambda: ROWS.replace("\n", "\r\n").encode(),
    "old Mac": lambda: ROWS.replace("\n", "\r").encode(),
    "German": lambda: ROWS.replace(",", ";").replace(".", ",").encode(),
    "tabs": lambda: ROWS.replace(",", "\t").encode(),
    "blanks": lambda: ROWS.replace(",", "  ").encode(),
    "capitals": lambda: ROWS.replace("time,player,x,y", "Time, PLAYER,X ,Y").encode(),
    "Excel": lambda: b"sep=;\n" + ROWS.replace(",", ";").encode(),
    "comments": lambda: (
        "# of a drive\n\n" + ROWS.replace("0.2", "# stop\n0.2") + "# end\n"
    ).encode(),
    "commented names": lambda: b"# by me\n# " + ROWS.encode(),
    "no last line": lambda: ROWS.strip().encode(),
    "open ends": lambda: ROWS.replace("1.5\n", "1.5,\n").encode(),
    "gz": lambda: gzip.compress(ROWS.encode()),
}


@pytest.mark.parametrize("way", WRITTEN)
def test_a_table_may_be_written_in_many_ways(path: Path, way: str) -> None:
    path.write_bytes(WRITTEN[way]())
    imported = read_tracks(path)
    assert players(imported) == ["a"] and imported.notes == ()
    np.testing.assert_allclose(states(imported)[:, 0, :2], [[0, 1.5], [1, 1.5], [2, 1.5]])


def test_names_may_have_commas_and_umlauts(path: Path) -> None:
    rows = ROWS.replace(",a,", ',"Müller, rot",')
    for encoding in ("utf-8", "cp1252", "utf-16"):
        path.write_bytes(rows.encode(encoding))
        assert players(read_tracks(path)) == ["Müller, rot"]


def test_archives_of_one_file_are_read(tmp_path: Path) -> None:
    path = tmp_path / "tracks.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("folder/tracks.csv", ROWS)
    assert players(read_tracks(path)) == ["a"]
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("more.csv", ROWS)
    with pytest.raises(UserError, match="is an archive of 2 files, expected one: folder/tracks"):
        read_tracks(path)


def test_a_foreign_file_says_what_it_is(path: Path) -> None:
    for text, name, said in (
        ("time,player,x,y\n", "csv", "has column names, but no rows"),
        ("# time,player,x,y\n", "csv", "has column names, but no rows"),
        ("PAR1 and more", "csv", "is a Parquet file, not a table of text"),
        ("<fcd-export/>", "csv", "is an XML file"),
        ("<commonRoad/>", "sumo", "its root is <commonRoad>, not <fcd-export>"),
        ("<fcd-export/>", "sumo", "has no vehicles"),
        ("<fcd-export/>", "commonroad", "its root is <fcd-export>, not <commonRoad>"),
        ('<commonRoad timeStepSize="0.1"/>', "commonroad", "has no dynamic obstacles"),
        ("Vehicle_ID,Frame_ID,Local_X\n1,2,3\n", "csv", "this looks like --format ngsim"),
        (ROWS, "highd", "this looks like --format csv"),
    ):
        path.write_text(text)
        with pytest.raises(UserError, match=said):
            read_tracks(path, name)


# -- CommonRoad and maps


def state(step: int, x: float, y: float, *, more: str = "", tag: str = "state") -> str:
    return (
        f"<{tag}><position><point><x>{x}</x><y>{y}</y><z>3</z></point></position>"
        f"<time><exact>{step}</exact></time>{more}</{tag}>"
    )


def obstacle(number: int, vx: float, vy: float, *, kind: str = "car", old: bool = False) -> str:
    """Of a point mass."""
    more = f"<velocity><exact>{vx}</exact></velocity><velocityY><exact>{vy}</exact></velocityY>"
    rows = [
        state(k, round(0.1 * k * vx, 6), round(0.1 * k * vy, 6), more=more) for k in range(1, 11)
    ]
    tag, role = ("obstacle", "<role>dynamic</role>") if old else ("dynamicObstacle", "")
    start = state(0, 0, 0, more=more, tag="initialState")
    trajectory = f"<trajectory>{''.join(rows)}</trajectory>"
    return f'<{tag} id="{number}">{role}<type>{kind}</type>{start}{trajectory}</{tag}>'


def lanelet(number: int, start: float, end: float, after: int = 0, points: str = "") -> str:
    sides = [
        f"<{side}Bound>"
        + "".join(f"<point><x>{x}</x><y>{y}</y><z>1</z></point>" for x in (start, end))
        + points * (side == "left")
        + f"</{side}Bound>"
        for side, y in (("left", 2), ("right", -2))
    ]
    following = f'<successor ref="{after}"/>' * bool(after)
    return f'<lanelet id="{number}">{"".join(sides)}{following}</lanelet>'


def commonroad(path: Path, *elements: str) -> Imported:
    path.write_text(f'<commonRoad timeStepSize="0.1">{"".join(elements)}</commonRoad>')
    return read_tracks(path, "commonroad")


@pytest.mark.parametrize("old", [False, True])
@pytest.mark.parametrize("velocity", [(10, 10), (0, 10), (-5, 0), (-6, 8)])
def test_point_masses_have_two_velocities(
    path: Path, velocity: tuple[float, float], old: bool
) -> None:
    found = states(commonroad(path, obstacle(1, *velocity, old=old)))[:, 0]
    np.testing.assert_allclose(found[:, 3], np.hypot(*velocity))
    np.testing.assert_allclose(found[:, 2], np.arctan2(velocity[1], velocity[0]))


def test_one_obstacle_that_is_uncertain_or_none_refuses_no_other(path: Path) -> None:
    uncertain = obstacle(2, 5, 0).replace("<x>1.5</x>", "<x>one</x>")
    interval = "<time><intervalStart>1</intervalStart><intervalEnd>2</intervalEnd></time>"
    range_of_time = obstacle(3, 5, 1).replace("<time><exact>4</exact></time>", interval)
    imported = commonroad(
        path,
        *(obstacle(1, 10, 0), uncertain, range_of_time, obstacle(4, 1, 0, kind="pedestrian")),
        '<staticObstacle id="5"><type>parkedVehicle</type></staticObstacle>',
        '<dynamicObstacle id="6"/>',
    )
    assert players(imported) == ["1", "2", "3"]
    assert np.isnan(states(imported)[3, 1, 0]) and np.isnan(states(imported)[4, 2, 0])
    notes = "; ".join(imported.notes)
    for said in ("static: 5", "trajectory: 6", "1 states of obstacle 2", "no vehicles: 4 (pedes"):
        assert said in notes


def test_one_lanelet_that_is_wrong_refuses_no_other(path: Path) -> None:
    wrong = lanelet(8, 20, 40, 9, points="<point><x>1</x><y>1</y></point>")
    car = obstacle(1, 10, 0)
    imported = commonroad(path, car, lanelet(7, -5, 20, 8), wrong, lanelet(9, 40, 60))
    road = imported.recording.metadata.episodes[0].road
    assert road is not None
    following = {name: lane.following for name, lane in road.lanes.items()}
    assert following == {"7": ["9"], "9": []}
    assert any("lane '8': its borders have 3 and 2 points" in note for note in imported.notes)
    assert commonroad(path, car, wrong).recording.metadata.episodes[0].road is None


def test_lanes_lead_past_one_of_no_length(tmp_path: Path) -> None:
    path = tmp_path / "road.net.xml"
    net = (
        '<net><edge id="a"><lane id="a_0" shape="0,0,1 9,0,1"/></edge>'
        '<edge id=":j" function="internal"><lane id=":j_0" shape="9,0 9,0"/></edge>'
        '<edge id="-b"><lane id="-b_0" shape="9,0 20,0"/></edge>'
        '<connection from="a" to="-b" fromLane="0" toLane="0" via=":j_0"/>'
        '<connection from=":j" to="-b" fromLane="0" toLane="0"/></net>'
    )
    path.write_bytes(gzip.compress(net.encode()))
    road = read_net(path)
    assert {name: lane.following for name, lane in road.lanes.items()} == {
        "a_0": ("-b_0",),
        "-b_0": (),
    }
    assert road.notes == ("left out: lane ':j_0': a lane needs at least two different points",)


def test_sumo_may_leave_out_attributes_and_has_persons(tmp_path: Path) -> None:
    path = tmp_path / "fcd.xml.gz"
    steps = "".join(
        f'<timestep time="{k / 10}"><vehicle id="a" x="{2 + k}" y="1" type="truck" length="4"/>'
        f'<vehicle id="b" x="-1073741824.00" y="-1073741824.00" angle="0" speed="0"/>'
        f'<vehicle x="0" y="0"/><vehicle id="c" x="{"?" if k == 9 else 5 * k}" y="0"/>'
        f'<person id="p" x="{k / 10}" y="4" angle="90" speed="1"/></timestep>'
        for k in range(20)
    )
    path.write_bytes(gzip.compress(f"<fcd-export>{steps}</fcd-export>".encode()))
    imported = read_tracks(path, "sumo")
    assert players(imported) == ["a", "c"]
    np.testing.assert_allclose(states(imported)[:, 0, 0], np.arange(20), atol=1e-9)
    assert np.flatnonzero(np.isnan(states(imported)[:, 1, 0])).tolist() == [9]
    notes = "; ".join(imported.notes)
    assert "left out: vehicle None at time 0: it has no 'id', and 20 more" in notes
    assert "without a position: 20 rows" in notes and "no vehicles: p (person)" in notes


def test_maps_of_interaction_may_be_in_metres(tmp_path: Path) -> None:
    path = tmp_path / "map.osm_xy"
    nodes = "".join(
        f"<node id='{k}' x='{1000 + 20 * (k % 2)}' y='{990 + 3 * (k // 2)}'/>" for k in range(6)
    )
    ways = "".join(
        f"<way id='{k}'><nd ref='{2 * k}'/><nd ref='{2 * k + 1}'/></way>" for k in range(3)
    )
    relations = "".join(
        f"<relation id='{9 + k}'><member role='left' ref='{k + 1}'/><member role='right' "
        f"ref='{way}'/><tag k='type' v='lanelet'/></relation>"
        for k, way in enumerate((0, 7))
    )
    path.write_text(f"<osm>{nodes}{ways}{relations}</osm>")
    road = read_lanelets(path)
    np.testing.assert_allclose(road.lanes["9"].line, [[1000, 991.5], [1020, 991.5]])
    assert road.notes == ("left out: lanelet 10 names way 7, which is not there",)
