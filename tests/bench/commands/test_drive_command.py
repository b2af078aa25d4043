"""``olne-bench drive``."""

import json

import pandas as pd
import pytest
from PIL import Image

from olne_bench.bench.run.drive_file import COLUMNS, DriveFile

#: HighwayEnv's drivers need no game, and no compiler.
QUICK = ["drive", "--traffic", "stock", "--planner", "stock", "--road", "two_way", "--jobs", 1]


def test_a_study_goes_on_where_it_was_interrupted(study) -> None:
    out = study.folder / "drives"
    said = study.call(*QUICK, "--road", "merge", "--seeds", 1, "--out", out, "--no-figures")
    assert "2 of 2 drives are left" in said
    rows = pd.read_csv(out / "episodes.csv")
    assert tuple(rows.columns) == COLUMNS
    assert rows["road"].tolist() == ["two_way", "merge"]
    assert (rows["status"] == "ok").all() and not rows["collision"].any()
    assert (rows["progress"] > 50).all() and (rows["cost"] > 0).all()
    assert json.loads((out / "drive.json").read_text())["window"] == 6

    whole = (out / "episodes.csv").read_bytes()
    (out / "episodes.csv").write_bytes(whole[:-20])  # the machine died while it wrote
    said = study.call(*QUICK, "--road", "merge", "--seeds", 1, "--out", out)
    assert "1 of 2 drives are left" in said
    assert (out / "episodes.csv").read_bytes() == whole
    assert len(pd.read_csv(out / "summary.csv")) == 3
    assert (out / "driving_stock.png").is_file()

    said = study.call(*QUICK, "--window", 5, "--out", out, code=2)
    assert "--window 5 differs from that of the study" in said


def test_rows_of_other_code_are_run_again(study) -> None:
    out = study.folder / "drives"
    words = [*QUICK, "--seeds", 1, "--out", out, "--no-figures"]
    study.call(*words)
    as_text = {"code": str}  # one like 3e785277 is no number
    rows = pd.read_csv(out / "episodes.csv", dtype=as_text)
    code = rows["code"][0]
    former = rows.assign(planner=["stock"], code="0123456789ab")
    unknown = rows.assign(planner=["a_plugin"])
    pd.concat([former, unknown]).to_csv(out / "episodes.csv", index=False)
    said = study.call(*words)
    assert "1 of 1 drives are left" in said
    assert "not in the tables, as their code has changed: a_plugin" in said
    rows = pd.read_csv(out / "episodes.csv", dtype=as_text)
    assert rows["code"].tolist() == ["0123456789ab", code, code]
    assert pd.read_csv(out / "summary.csv")["planner"].unique().tolist() == ["stock"]


@pytest.mark.long
@pytest.mark.parametrize("where", [("--jobs", 2), ("--dask", "local:2")], ids=["jobs", "dask"])
def test_rows_do_not_depend_on_where_they_are_made(study, where) -> None:
    words = [*QUICK[:-2], "--planner", "constant_velocity", "--seeds", 2, "--no-figures"]
    study.call(*words, "--jobs", 1, "--out", study.folder / "one")
    study.call_alone(*words, *where, "--out", study.folder / "more")
    one, more = (
        DriveFile(study.folder / name / "episodes.csv")
        .read()
        .drop(columns=["cycle_50", "cycle_95", "cycle_99"])
        .sort_values(["planner", "seed"], ignore_index=True)
        for name in ("one", "more")
    )
    assert len(one) == 4
    pd.testing.assert_frame_equal(one, more, check_exact=True)


def test_faults_of_the_harness_are_run_again(tmp_path) -> None:
    file = DriveFile(tmp_path / "episodes.csv")
    key = dict(
        zip(COLUMNS, ("merge", "nash", "dirichlet", 0.1, 3, "abc", "map", "f00"), strict=False)
    )
    file.add(key | {"status": "harness_error", "message": "a, b"})
    assert not file.done()
    file.add(key | {"status": "ok"})
    assert file.done() == {("merge", "nash", "dirichlet", "0.1", "3", "abc", "map", "f00")}
    assert len(file.read()) == 1


def test_a_film_shows_a_drive(study) -> None:
    film = study.folder / "drive.gif"
    said = study.call(*QUICK, "--video", film, "--seed", 1)
    assert "101 frames, no collision" in said
    with Image.open(film) as picture:
        assert picture.n_frames > 50  # equal frames become one
        assert picture.size[0] > picture.size[1]
    assert "exists already" in study.call(*QUICK, "--video", film, code=2)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--road", "motorway"], "--road 'motorway' is unknown; known are: highway, merge"),
        (["--planner", "mapp"], "--planner 'mapp' is unknown; known are: oracle, uniform"),
        (["--planner", "map", "--planner", "map"], "--planner 'map' is named twice"),
        (["--window", "101"], "--window 101: a drive has 100 samples"),
        (["--window", "1"], "--window"),
        (["--deadline", "0.0001"], "--deadline"),
        (["--sigma", "nan"], "--sigma"),
        (["--traffic", "none"], "--traffic"),
        (["--salt", ""], "--salt"),
        (["--video", "film.avi"], "either --out"),
    ],
)
def test_bad_input_is_one_line(study, words: list[str], message: str) -> None:
    said = study.call("drive", *words, "--out", study.folder / "drives", code=2)
    assert message in said
    assert not (study.folder / "drives").exists()


def test_other_folders_and_several_films_are_refused(study) -> None:
    said = study.call("drive", "--out", study.folder, code=2)
    assert "is not empty and has no drive.json" in said
    said = study.call("drive", "--video", study.folder / "film.gif", "--road", "merge", code=2)
    assert "--video shows one drive, and 7 are asked for" in said
    assert "either --out" in study.call("drive", code=2)
