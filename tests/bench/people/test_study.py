"""Halves of the recordings, rows and their summary, and the command."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.people.cases import HORIZONS
from olne_bench.bench.people.study import rows_of, second_half, shown, summary
from tests.bench.commands.test_people_commands import fails, run
from tests.bench.people.test_rivals import CASES, case


def test_pieces_of_a_road_are_in_its_halves_in_turn():
    pieces = {"a1": "A", "a2": "A", "a3": "A", "b1": "B", "b2": "B"}
    assert second_half(pieces) == {"a2", "b2"}


def test_rows_and_summary_hold_every_case_method_and_horizon():
    second = {"piece 1", "piece 3", "piece 5"}
    rows = rows_of(CASES, second)
    assert len(rows) == 60 * 4 * 7 and rows["half"].value_counts().to_dict() == {
        "first": 840,
        "second": 840,
    }
    table = summary(rows)
    assert set(table["half"]) == {"first", "second", "both"}
    one = table.query("half == 'both' and kind == 'all' and ahead == 3").set_index("method")
    assert one.loc["straight", "over_straight"] == 1
    off = np.array([(c.predicted["game"] - c.happened)[2] for c in CASES])
    assert one.loc["game", "along"] == pytest.approx(np.abs(off[:, 0]).mean())
    base = np.mean([abs((c.predicted["straight"] - c.happened)[2, 0]) for c in CASES])
    assert one.loc["game", "over_straight"] == pytest.approx(np.abs(off[:, 0]).mean() / base)
    assert one.loc["ridge", "over_straight_high"] < 0.3
    assert list(shown(table).columns) == ["game", "alone", "idm", "mobil", "ridge", "kernel"]


def test_a_car_without_samples_of_its_weights_stays_in_the_table():
    """It is predicted with equal weights."""
    rng = np.random.default_rng(0)
    known = [
        replace(
            one,
            samples=rng.dirichlet(np.full(4, 5.0), (20, 3)),
            sampled=np.repeat(one.happened[None] + 0.1, 20, axis=0),
        )
        for one in CASES[1:]
    ]
    rows = rows_of([CASES[0], *known], set())
    found = rows[rows["method"] == "population"]
    assert len(found) == 60 * len(HORIZONS) and found["score"].notna().all()
    game = rows[rows["method"] == "game"]["along"].to_numpy()
    assert (found["along"].to_numpy() == game).sum() == len(HORIZONS)
    assert "population" in shown(summary(rows))


def test_the_second_half_does_not_change_what_is_fitted():
    second = {"piece 1", "piece 3", "piece 5"}
    alone = rows_of([c for c in CASES if c.piece not in second], second)
    whole = rows_of(CASES, second)
    first = whole[whole["half"] == "first"].reset_index(drop=True)
    pd.testing.assert_frame_equal(first, alone)
    # Nor do other cases of the second half change how one of it is predicted.
    fewer = rows_of([c for c in CASES if c.piece not in second] + [case(7, 1)], second)
    kept = fewer[fewer["half"] == "second"]["along"].to_numpy()
    of = whole[(whole["half"] == "second")].iloc[: len(kept)]
    assert np.isin(kept.round(9), whole["along"].round(9)).all() and len(of) == len(kept)


def test_a_half_is_opened_once(data, tmp_path, capsys):
    out = tmp_path / "out"
    given = ("people", data, "--format", "csv", "--jobs", 1, "--out", out)
    run(*given)
    assert "4 pieces of recording are not opened" in capsys.readouterr().out
    first = pd.read_parquet(out / "predictions.parquet")
    assert set(first["half"]) == {"first"} and first["piece"].nunique() == 4
    run(*given, "--open")
    said = capsys.readouterr().out
    assert "second all 8" in " ".join(said.split()) and "not opened" not in said
    both = pd.read_parquet(out / "predictions.parquet")
    pd.testing.assert_frame_equal(first, both[both["half"] == "first"].reset_index(drop=True))
    assert both["piece"].nunique() == 8 and (out / "people.png").stat().st_size > 10_000
    assert len(json.loads((out / "opened.json").read_text())) == 1
    assert "the second half of these recordings was opened on" in fails(capsys, *given, "--open")
    pd.testing.assert_frame_equal(both, pd.read_parquet(out / "predictions.parquet"))
    # Another recording in the second half is other data.
    table = pd.read_csv(data / "A_Lane-7_1.csv")
    table.assign(x=table["x"] + 0.01 * table["time"]).to_csv(data / "A_Lane-7_1.csv", index=False)
    run(*given, "--open")
    assert len(json.loads((out / "opened.json").read_text())) == 2


def test_names_of_files_are_no_formulas(data, tmp_path):
    for path in sorted(data.iterdir()):
        path.rename(data / path.name.replace("_Lane-", "_=1+1-"))
    out = tmp_path / "out"
    run("people", data, "--format", "csv", "--jobs", 1, "--out", out)
    assert set(pd.read_csv(out / "summary.csv")["road"]) == {"'=1+1"}


def test_bad_input_is_one_line_and_writes_nothing(data, tmp_path, capsys):
    out, empty = tmp_path / "out", tmp_path / "empty"
    empty.mkdir()
    assert "expected a folder of recordings" in fails(capsys, "people", empty, "--out", out)
    assert "expected a folder of recordings" in fails(
        capsys, "people", tmp_path / "no", "--out", out
    )
    given = ("people", data, "--format", "csv", "--jobs", 1, "--out", out)
    (tmp_path / "file").write_text("")
    wrong = (*given[:-1], tmp_path / "file" / "out")
    assert "cannot write to" in fails(capsys, *wrong)
    (empty / "notes.txt").write_text("mine")
    assert "'notes.txt' is one of 1" in fails(capsys, *given[:-1], empty)
    one = tmp_path / "one"
    one.mkdir()
    for path in data.glob("A_Lane-0_1.*"):
        (one / path.name).write_bytes(path.read_bytes())
    assert "expected at least two to develop on, got 1" in fails(capsys, "people", one, *given[2:])
    out.rmdir()
    for path in data.glob("*.csv"):
        table = pd.read_csv(path)
        table[table["time"] < 5].to_csv(path, index=False)
    assert "no car in a lane has a leader and is seen for 5.7 s" in fails(capsys, *given)
    for path in data.glob("*.toml"):
        path.unlink()
    assert "no recording has lanes" in fails(capsys, *given)
    assert not out.exists()
