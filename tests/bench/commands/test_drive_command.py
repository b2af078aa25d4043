"""Studies of drives, and films."""

import re

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from olne_bench.bench.report.drive_tables import COLUMNS

#: HighwayEnv's drivers need no game, and no compiler.
QUICK = ["run", "driving_stock", "--estimator", "stock", "--scenario", "two_way", "--jobs", 1]


def test_a_study_goes_on_where_it_was_interrupted(study) -> None:
    out = study.folder / "drives"
    study.call(*QUICK, "--seeds", 1, "--out", out, "--no-figures")
    rows = pd.read_csv(out / "episodes.csv")
    assert tuple(rows.columns) == COLUMNS
    assert rows[["road", "traffic", "planner"]].values.tolist() == [["two_way", "stock", "stock"]]
    assert (rows["status"] == "ok").all() and not rows["collision"].any()
    assert (rows["progress"] > 50).all() and (rows["cost"] > 0).all()

    words = [*QUICK, "--scenario", "merge", "--seeds", 1, "--out", out]
    assert "1 of 2 trials are done already" in study.call(*words)
    assert len(pd.read_csv(out / "summary.csv")) == 3
    assert (out / "figures" / "driving_stock.png").is_file()
    page = (out / "index.html").read_text()
    assert "olne-bench run driving_stock" in page and "<svg" in page
    assert re.search(r"stock +1 +0 +0 +0 +29", study.call("status", out))

    said = study.call(*words, "--rule", "window=5", code=2)
    assert "holds a run of suite 'driving_stock', not 'driving_stock (changed)'" in said


@pytest.mark.long
@pytest.mark.parametrize("where", [("--jobs", 2), ("--dask", "local:2")], ids=["jobs", "dask"])
def test_rows_do_not_depend_on_where_they_are_made(study, where) -> None:
    words = [*QUICK[:-2], "--estimator", "constant_velocity", "--seeds", 2, "--no-figures"]
    study.call(*words, "--jobs", 1, "--out", study.folder / "one")
    study.call_alone(*words, *where, "--out", study.folder / "more")
    one, more = (
        pd.read_csv(study.folder / name / "episodes.csv").drop(
            columns=["cycle_50", "cycle_95", "cycle_99"]
        )
        for name in ("one", "more")
    )
    assert len(one) == 4
    pd.testing.assert_frame_equal(one, more, check_exact=True)


def test_a_film_shows_a_drive(study) -> None:
    film = study.folder / "drive.gif"
    words = ["film", "two_way", "--suite", "driving_stock", "--planner", "stock", "--out", film]
    assert "101 frames, no collision" in study.call(*words, "--seed", 1)
    with Image.open(film) as picture:
        assert picture.n_frames > 50  # equal frames become one
        assert picture.size[0] > picture.size[1]
    assert "exists already" in study.call(*words, code=2)


def test_a_film_shows_the_same_start_with_two_planners(study) -> None:
    film = study.folder / "both.gif"
    words = ["film", "merge", "--suite", "driving_stock", "--seed", 1, "--out", film]
    said = study.call(*words, "--planner", "constant_velocity", "--planner", "stock")
    assert re.search(r"draw 1: constant_velocity: \d+ frames, .*cost 0\.\d+; status ok", said)
    assert re.search(r"draw 1: stock: \d+ frames, .*cost 0\.\d+; status ok", said)
    with Image.open(film) as picture:
        upper, lower = (
            np.asarray(picture.convert("RGB").crop((0, top, 720, top + 240))) for top in (0, 240)
        )
        assert picture.size == (720, 480)
    road = slice(60, 200)
    assert (upper[road, :20] == lower[road, :20]).all(), "the same place on the same road"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["motorway"], "has no scenario 'motorway'; it has: highway, merge"),
        (["merging"], "drives are on one of highway, merge"),
        (["merge", "--planner", "mapp"], "has no estimator 'mapp'; it has: oracle, uniform"),
        (["merge", "--suite", "online"], "--suite 'online' is a study of streams, not of drives"),
    ],
)
def test_bad_films_are_one_line(study, words: list[str], message: str) -> None:
    film = study.folder / "film.gif"
    assert message in study.call("film", *words, "--out", film, code=2)
    assert not film.exists()
