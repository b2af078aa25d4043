"""Tracks read from CSV: the resulting states, and the messages on bad files."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from olne_bench.envs.tracks.grid import Excerpt, Frame
from olne_bench.envs.tracks.reading import read_tracks
from olne_bench.errors import UserError

DT, STEPS = 0.5, 9
TIMES = DT * np.arange(STEPS)


def drive(player: str, speed: float, heading: float, shift: float) -> pd.DataFrame:
    """Straight ahead from (0, shift)."""
    return pd.DataFrame(
        {
            "time": TIMES,
            "player": player,
            "x": speed * np.cos(heading) * TIMES,
            "y": shift + speed * np.sin(heading) * TIMES,
            "heading": heading,
            "speed": speed,
        }
    )


def two() -> pd.DataFrame:
    cars = [drive("red", 10.0, 0.3, 0.0), drive("blue", 4.0, 0.0, 5.0)]
    return pd.concat(cars, ignore_index=True)


@pytest.fixture
def read(tmp_path: Path) -> Callable[[pd.DataFrame], np.ndarray]:
    """``read(table)``: the states (T, N, 4) of a table on disk."""

    def of(table: pd.DataFrame) -> np.ndarray:
        path = tmp_path / "tracks.csv"
        table.to_csv(path, index=False)
        return read_tracks(path).recording.states[0]

    return of


def test_a_car_that_comes_and_goes_has_missing_samples(tmp_path: Path) -> None:
    path = tmp_path / "tracks.csv"
    two().drop(index=[9, 10, 13, 17]).to_csv(path, index=False)
    imported = read_tracks(path)
    states = imported.recording.states[0]
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(states[:, 1, 0])), [0, 1, 4, 8])
    assert np.isfinite(states[:, 0]).all()
    assert imported.notes == (
        "player 'blue' is seen at 5 of 9 times; the others are missing samples",
    )


def test_window_players_and_step_are_chosen(tmp_path: Path) -> None:
    path = tmp_path / "tracks.csv"
    two().to_csv(path, index=False)
    recording = read_tracks(path, excerpt=Excerpt((1.0, 3.0), ("blue",), 0.4)).recording
    np.testing.assert_allclose(recording.times[0], 1.0 + 0.4 * np.arange(6))
    assert recording.metadata.dt == pytest.approx(0.4)
    np.testing.assert_allclose(recording.states[0][:, 0, 0], 4 * recording.times[0])


def test_frames_turn_positions_and_headings(tmp_path: Path) -> None:
    path = tmp_path / "tracks.csv"
    two().to_csv(path, index=False)
    frame = Frame(flip_y=True, rotate=np.pi / 2, shift=(3.0, -1.0))
    states = read_tracks(path, frame=frame).recording.states[0]
    x, y = 10 * np.cos(0.3) * TIMES, -10 * np.sin(0.3) * TIMES
    np.testing.assert_allclose(states[:, 0, :2], np.column_stack([-y + 3, x - 1]), atol=1e-9)
    np.testing.assert_allclose(states[:, 0, 2], np.pi / 2 - 0.3)


def test_a_road_file_beside_the_tracks_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "tracks.csv"
    two().to_csv(path, index=False)
    (tmp_path / "tracks.toml").write_text(
        'scenario = "highway"\n[lanes.a]\npoints = [[0, 0], [50, 0]]\n'
        '[players.red]\ntargets = { speed = 9 }\nlanes = ["a"]\n'
    )
    imported = read_tracks(path)
    metadata = imported.recording.metadata
    assert metadata.scenario == "highway"
    road = metadata.episodes[0].road
    assert road is not None and road.players["red"].targets == {"speed": 9.0}
    assert imported.notes[-1].startswith("lanes and targets: 1 lanes, 1 players of ")
    (tmp_path / "tracks.toml").write_text("[players.green]\n")
    with pytest.raises(UserError, match=r"'green', which is not in .*; there are: red, blue"):
        read_tracks(path)
    with pytest.raises(UserError, match=r"the name must end in .toml, .xml, .osm or .osm_xy"):
        read_tracks(path, road=path)


def test_states_are_by_time_and_by_the_players_first_rows(tmp_path: Path) -> None:
    path = tmp_path / "tracks.csv"
    two().assign(colour="any").sample(frac=1, random_state=1).sort_values(
        ["player", "time"], ascending=[False, True]
    ).to_csv(path, index=False)
    imported = read_tracks(path)
    recording = imported.recording
    assert recording.metadata.dt == pytest.approx(DT)
    assert recording.metadata.episodes[0].players == ["red", "blue"]
    states = recording.states[0]
    assert states.shape == (STEPS, 2, 4)
    assert recording.controls[0].shape == (STEPS - 1, 2, 0)
    np.testing.assert_allclose(states[:, 0, 0], 10 * np.cos(0.3) * TIMES)
    np.testing.assert_allclose(states[:, 1, 1], 5.0)
    np.testing.assert_allclose(states[:, 0, 2:], np.tile([0.3, 10.0], (STEPS, 1)))
    assert imported.notes == ("not used: column colour",)


def test_headings_are_unwrapped_across_gaps(read: Callable[[pd.DataFrame], np.ndarray]) -> None:
    table = two()
    angle = 3.0 + 0.1 * np.arange(STEPS)
    wrapped = (angle + np.pi) % (2 * np.pi) - np.pi
    table.loc[:8, ["x", "y"]] = 10 * np.cumsum(
        DT * np.column_stack([np.cos(angle), np.sin(angle)]), axis=0
    )
    table.loc[:8, "heading"] = wrapped
    table.loc[2, ["x", "y", "heading", "speed"]] = np.nan
    expected = angle.copy()
    expected[2] = np.nan
    np.testing.assert_allclose(read(table)[:, 0, 2], expected, atol=1e-12)


def test_positions_alone_will_do(read: Callable[[pd.DataFrame], np.ndarray]) -> None:
    states = read(two()[["time", "player", "x", "y"]])
    assert np.isnan(states[..., 2:]).all()
    assert np.isfinite(states[..., :2]).all()


def test_who_stands_may_have_any_heading(read: Callable[[pd.DataFrame], np.ndarray]) -> None:
    table = two()
    table.loc[:8, ["x", "y", "speed"]] = [1.0, 1.0, 0.04]
    table.loc[:8, "heading"] = 2.0
    assert np.isfinite(read(table)).all()


def changed(rows: slice, **values: object) -> pd.DataFrame:
    table = two()
    for name, value in values.items():
        table.loc[rows, name] = value
    return table


FIRST = slice(0, 8)  # the rows of red; .loc includes the last
REFUSED = {
    "twice": (changed(slice(3, 3), time=1.0), "player 'red' has time 1 twice"),
    "unequal": (
        two().assign(time=two()["time"].replace(2.0, 2.1)),
        "unequal time steps: 0.6 s after time 1.5, mostly 0.5 s; --resample 0.5 makes",
    ),
    "unseen": (two().assign(x=np.nan), "player 'red' has no position at any time"),
    "mph": (changed(FIRST, speed=22.4), "has a mean speed of 22.4, but its positions move at 10"),
    "column": (two().drop(columns=["x", "y"]), "missing columns x, y; it has: time, player"),
    "nobody": (two().assign(player=""), "none of its rows has a player"),
    "no time": (changed(slice(4, 4), time=np.nan), "line 6: the row has no time"),
    "infinite": (changed(slice(4, 4), x=np.inf), "line 6: x is 'inf', expected a finite number"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_meant_is_refused(
    case: str, read: Callable[[pd.DataFrame], np.ndarray]
) -> None:
    table, words = REFUSED[case]
    with pytest.raises(UserError) as caught:
        read(table)
    assert words in str(caught.value)


def test_cells_may_be_empty_padded_or_say_that_they_are_missing(tmp_path: Path) -> None:
    path = tmp_path / "tracks.csv"
    rows = ["time , player,x,y,speed", "0, a ,0,0,1", "1,a,1,0,NA", "", "2,a,,n/a,1", "3,a,3,0,1"]
    path.write_text("\n".join(rows))
    recording = read_tracks(path).recording
    assert recording.metadata.episodes[0].players == ["a"]
    np.testing.assert_array_equal(recording.states[0][:, 0, 0], [0, 1, np.nan, 3])
    np.testing.assert_array_equal(recording.states[0][:, 0, 3], [1, np.nan, 1, 1])


def test_files_that_are_no_tables_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "tracks.csv"
    with pytest.raises(UserError, match="no tracks file"):
        read_tracks(path)
    path.write_text("")
    with pytest.raises(UserError, match="is empty; expected the columns time, player, x, y"):
        read_tracks(path)
    path.write_text("time,player,x,x,y\n")
    with pytest.raises(UserError, match="column 'x' appears twice"):
        read_tracks(path)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UserError, match="is not a CSV file"):
        read_tracks(path)
