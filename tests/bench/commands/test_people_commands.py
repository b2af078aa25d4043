"""Groups and predictions of recorded cars, by the command line and from Python."""

import numpy as np
import pandas as pd
import pytest
from PIL import Image

import olne_bench as ob
from olne_bench.bench.commands.cli import main

LANES = """
[lanes.right]
points = [[-50, 0], [400, 0]]

[lanes.left]
points = [[-50, 4], [400, 4]]
"""


@pytest.fixture
def tracks(tmp_path):
    """Thirty cars: in each lane a slow one leads, and the others come up behind it."""
    at, parts = 0.2 * np.arange(31), []
    for k in range(30):
        row, lane = divmod(k, 2)
        speed = 8.0 if row == 0 else 11.0
        x = 300 - 18 * row + speed * at
        parts.append(pd.DataFrame({"time": at, "player": f"car {k}", "x": x, "y": 4.0 * lane}))
    path = tmp_path / "tracks.csv"
    pd.concat(parts).to_csv(path, index=False)
    path.with_suffix(".toml").write_text(LANES)
    return path


def run(*arguments):
    main([str(argument) for argument in arguments])


def fails(capsys, *arguments):
    with pytest.raises(SystemExit) as caught:
        run(*arguments)
    assert caught.value.code == 2
    return capsys.readouterr().err.strip().splitlines()[-1]


def test_a_file_of_many_cars_has_groups_of_which_one_is_imported(tracks, tmp_path, capsys):
    assert "'olne-bench groups'" in fails(
        capsys, "import", tracks, "--out", tmp_path / "all.parquet"
    )
    run("groups", tracks, "--rows", 2)
    said = capsys.readouterr().out
    assert "car 2 follows car 0" in said and "weaker groups are not shown" in said
    run("import", tracks, "--group", 1, "--out", tmp_path / "one.parquet")
    assert "5 players, 31 steps" in capsys.readouterr().out
    # Groups of another size have other numbers; the last line says how to take the first.
    run("groups", tracks, "--most", 3, "--window", "0,2")
    asked = capsys.readouterr().out.splitlines()[-1].split("'")[1]
    assert asked.endswith("--most 3 --window 0,2 --group 1 --out NEW.parquet")
    run("import", tracks, *asked.split()[3:-1], tmp_path / "three.parquet")
    assert "3 players" in capsys.readouterr().out
    said = fails(capsys, "import", tracks, "--group", 99, "--out", tmp_path / "more.parquet")
    assert "--group 99: 'olne-bench groups" in said
    both = ("--group", 1, "--players", "car 1", "--out", tmp_path / "two.parquet")
    assert "give one of them" in fails(capsys, "import", tracks, *both)


def test_predictions_are_said_written_and_drawn(tracks, tmp_path, capsys):
    out, picture, film = (tmp_path / f"ahead.{kind}" for kind in ("csv", "png", "gif"))
    chosen = ("--players", "car 2,car 0", "--at", 2, "--ahead", 3)
    run("predict", tracks, *chosen, "--out", out, "--picture", picture, "--film", film)
    said = capsys.readouterr().out
    assert "mean error along the lane of the 1 with a leader" in said
    table = pd.read_csv(out)
    assert list(table["player"].unique()) == ["car 2", "car 0"]
    assert picture.stat().st_size > 10_000
    with Image.open(film) as frames:
        assert frames.n_frames == 16  # each 0.2 s of three, and now
    found = ob.predict(tracks, at=2.0, ahead=3.0, players=["car 2", "car 0"])
    pd.testing.assert_frame_equal(
        found.fillna(""), table.fillna(""), check_dtype=False, rtol=1e-6, atol=1e-6
    )
    end = found[found["player"] == "car 2"].iloc[-1]
    assert end["game_x"] < end["straight_x"] - 1  # it slows down behind the slow one


def test_bad_input_is_one_line_and_writes_nothing(tracks, tmp_path, capsys):
    out = tmp_path / "ahead.csv"
    for options, said in (
        (("--at", 99), "--at 99: the recording has times from 0 to 6 s"),
        (("--players", "me"), "player 'me' is seen moving at 6 s"),
        (("--ahead", 99), "--ahead 99: expected 0.2 to 20 s"),
    ):
        assert said in fails(capsys, "predict", tracks, *options, "--out", out)
    assert not out.exists()
    tracks.with_suffix(".toml").unlink()
    assert "has no lanes" in fails(capsys, "predict", tracks)
