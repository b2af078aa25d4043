"""Submissions: packed, verified, and refused if anything has changed."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from olne_bench.bench.commands.cli import main
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.plan.trial import expand
from olne_bench.bench.report.submission.fresh import FreshErrors
from olne_bench.bench.report.submission.manifest import MANIFEST, ROWS, digest, read_submission
from olne_bench.bench.report.submission.pack import _plugin_places
from olne_bench.bench.report.submission.verify import (
    Verdict,
    _alike,
    _away_from_rows,
    _sample,
    _with_fresh_salt,
)
from olne_bench.errors import UserError

SUITE = """
name = "tiny"
scenarios = ["two_player"]
sensors = ["full"]
sigmas = [0.01, 0.1]
seeds = 3
time_limit = 20.0
estimators = ["uniform"]
"""
PLUGIN = """
from types import SimpleNamespace
from beside import LEAST


class Drawn:
    name = "Drawn"

    def estimate(self, problem, observation, *, rng, budget):
        return SimpleNamespace(weights=rng.uniform(LEAST, 1, (2, 4)))
"""


def call(*words: object) -> int:
    """The exit code of a command."""
    try:
        main([str(word) for word in words])
    except SystemExit as end:
        return int(end.code or 0)
    return 0


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a suite, a plugin and its helper, and a run of them."""
    folder = tmp_path_factory.mktemp("work")
    (folder / "tiny.toml").write_text(SUITE)
    (folder / "drawn.py").write_text(PLUGIN)
    (folder / "beside.py").write_text("LEAST = 0.5\n")
    (folder / "unrelated.py").write_text("")
    arguments = [folder / "tiny.toml", "--plugin", folder / "drawn.py", "--no-figures"]
    assert call("run", *arguments, "--out", folder / "run") == 0
    return folder / "run"


@pytest.fixture(scope="module")
def packed(run: Path) -> Path:
    out = run.parent / "packed"
    assert call("submit", run, "--name", "drawn", "--out", out) == 0
    return out


@pytest.fixture
def submission(packed: Path, tmp_path: Path) -> Path:
    """A copy that a test may change."""
    return Path(shutil.copytree(packed, tmp_path / "submission"))


def manifest(folder: Path) -> dict:
    data: dict = json.loads((folder / MANIFEST).read_text())
    return data


def sign(folder: Path) -> None:
    """Update the manifest to the present files, as a forger would."""
    data = manifest(folder)
    data["files"] = {place: digest(folder / place) for place in data["files"]}
    (folder / MANIFEST).write_text(json.dumps(data))


def change_rows(folder: Path, change: Callable[[pd.DataFrame], pd.DataFrame]) -> None:
    table = pq.read_table(folder / ROWS)
    frame = change(table.to_pandas())
    pq.write_table(table.schema.empty_table().from_pandas(frame, table.schema), folder / ROWS)
    sign(folder)


def verify(folder: Path, *options: object) -> int:
    return call("verify", folder, "--sample", "12", "--seed", "1", "--jobs", "1", *options)


def test_what_is_packed_is_accepted_and_holds_all_that_is_needed(packed: Path, capsys) -> None:
    places = {p.relative_to(packed).as_posix() for p in packed.rglob("*") if p.is_file()}
    assert places == {
        "leaderboard.csv",
        "leaderboard.md",
        "plugins/drawn/beside.py",
        "plugins/drawn/drawn.py",
        "submission.json",
        "trials.parquet",
    }
    text = (packed / MANIFEST).read_text()
    assert str(packed.parent) not in text  # this folder exists only here
    assert json.loads(manifest(packed)["runs"][0]["suite"])["salt"] == "tiny"
    assert verify(packed) == 0
    said = capsys.readouterr().out
    assert "12 of 12 rows run again are the same, bit by bit" in said
    assert "accepted" in said


def test_a_row_that_was_made_better_is_found(submission: Path, capsys) -> None:
    def better(rows: pd.DataFrame) -> pd.DataFrame:
        row = rows.index[rows["estimator"] == "Drawn"][2]
        rows.loc[row, "cosine_error"] *= 0.999999
        return rows

    change_rows(submission, better)
    assert verify(submission) == 1
    said = capsys.readouterr().out
    assert said.count("DIFFERS  Drawn, two_player, full, sigma 0.01, seed 2: cosine_error is") == 1
    assert "refused" in said


def test_rows_that_nobody_can_repeat_are_held_against_a_fresh_salt(
    submission: Path, capsys
) -> None:
    def too_good(rows: pd.DataFrame) -> pd.DataFrame:
        own = rows["estimator"] == "Drawn"
        rows["environment_version"] = "0123456789ab"
        rows.loc[own, "position_error"] = 1e-9
        return rows

    data = manifest(submission)
    data["runs"][0]["environment"]["numpy"] = "1.0"
    (submission / MANIFEST).write_text(json.dumps(data))
    change_rows(submission, too_good)
    (submission / "leaderboard.csv").write_text(leaderboard_of(submission))
    sign(submission)
    assert verify(submission, "--strict") == 2
    assert "12 of 12 rows are of other versions: numpy 1.0 there," in capsys.readouterr().err
    assert verify(submission) == 1
    said = capsys.readouterr().out
    assert "12 rows cannot be repeated bit by bit: numpy 1.0 there" in said
    assert "TOO GOOD  Drawn: median position_error 1e-09 submitted" in said


def test_a_plugin_does_not_find_its_rows_beside_itself(packed: Path) -> None:
    with _away_from_rows(read_submission(packed)) as home:
        found = {p.relative_to(home).as_posix() for p in home.rglob("*") if p.is_file()}
        assert found == {"plugins/drawn/beside.py", "plugins/drawn/drawn.py"}
        assert not home.is_relative_to(packed)
    assert not home.exists()


def leaderboard_of(folder: Path) -> str:
    """The leaderboard of the rows."""
    from olne_bench.bench.report.statistics.attempts import weighed
    from olne_bench.bench.report.study import study_of
    from olne_bench.bench.report.submission.rows import read_rows
    from olne_bench.bench.report.tables import tabulate

    found = read_submission(folder)
    rows = read_rows(found).table
    return tabulate(weighed(rows), study_of(found.suites(folder))).leaderboard.to_csv(index=False)


def drop_one(folder: Path) -> None:
    change_rows(folder, lambda rows: rows.iloc[1:])


def double_one(folder: Path) -> None:
    change_rows(folder, lambda rows: pd.concat([rows, rows.iloc[:1]], ignore_index=True))


def edit_plugin(folder: Path) -> None:
    plugin = folder / "plugins/drawn/drawn.py"
    plugin.write_text(plugin.read_text().replace("LEAST, 1", "LEAST, 2"))


def edit_table(folder: Path) -> None:
    board = folder / "leaderboard.csv"
    table = pd.read_csv(board)
    table["cosine_error_median"] *= 0.9
    table.to_csv(board, index=False)
    sign(folder)


def lose_plugin(folder: Path) -> None:
    data = manifest(folder)
    del data["files"]["plugins/drawn/drawn.py"]
    (folder / MANIFEST).write_text(json.dumps(data))


def leave_folder(folder: Path) -> None:
    data = manifest(folder)
    data["files"]["../outside.py"] = "0"
    (folder / MANIFEST).write_text(json.dumps(data))


def link_elsewhere(folder: Path) -> None:
    plugins = folder / "plugins"
    plugins.rename(folder.parent / "elsewhere")
    plugins.symlink_to(folder.parent / "elsewhere")


@pytest.mark.parametrize(
    ("harm", "said"),
    [
        (drop_one, "lacks the row of Drawn, two_player, full, sigma 0.01, seed 0 (1 such in all)"),
        (double_one, "has 1 trials more than once"),
        (edit_plugin, "plugins/drawn/drawn.py was changed after it was submitted"),
        (edit_table, "is not the leaderboard of the rows beside it: see cosine_error_median"),
        (lose_plugin, "the plugin plugins/drawn/drawn.py of estimator 'Drawn' is missing"),
        (leave_folder, "'../outside.py' is not a file within a submission"),
        (link_elsewhere, "is not a file within a submission"),
        (lambda f: (f / ROWS).unlink(), "trials.parquet is missing"),
        (lambda f: (f / MANIFEST).unlink(), "it has no submission.json"),
        (lambda f: (f / MANIFEST).write_text("{}"), "is not the manifest of a submission"),
        (lambda f: (f / MANIFEST).write_text('{"format": 9}'), "has the format 9, this version"),
    ],
)
def test_harm_is_told_in_one_line(
    submission: Path, harm: Callable[[Path], object], said: str, capsys
) -> None:
    harm(submission)
    assert verify(submission) == 2
    errors = capsys.readouterr().err.strip()
    assert said in errors
    assert "\n" not in errors


def test_what_cannot_be_packed(run: Path, packed: Path, tmp_path: Path, capsys) -> None:
    def refused(folder: Path, *options: object) -> str:
        assert call("submit", folder, *options) == 2
        error: str = capsys.readouterr().err.strip()
        assert "\n" not in error
        return error

    assert "exists already" in refused(run, "--name", "drawn", "--out", packed)
    assert "a name has 1 to 60 of a-z" in refused(run, "--name", "../up")
    assert "no run in" in refused(tmp_path)
    new = tmp_path / "new"
    helper = run.parent / "beside.py"
    text = helper.read_text()
    helper.write_text("LEAST = 0.4\n")
    try:
        # Contents of files are cached within a process.
        from olne_bench.bench.plan import fingerprint, versions

        for cached in (fingerprint._content, fingerprint._summary, versions._version):
            cached.cache_clear()
        assert "6 of 12 trials in" in (told := refused(run, "--name", "x", "--out", new))
        assert "other code than the present one" in told
    finally:
        helper.write_text(text)
        for cached in (fingerprint._content, fingerprint._summary, versions._version):
            cached.cache_clear()
    assert not new.exists()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"sensors": ("mine.py:Sensor",)}, "mine.py:Sensor is a plugin that others' estimators"),
        ({"scenarios": ("mine.py",)}, "a submission brings estimators"),
        ({"metrics": ("mine.py",)}, "a submission brings estimators"),
        ({"estimators": ("installed",)}, "run it from its file, with --plugin FILE.py"),
    ],
)
def test_a_submission_brings_estimators_in_files(change: dict[str, tuple], said: str) -> None:
    usual = {"scenarios": ("two_player",), "sensors": ("full",), "estimators": ("uniform",)}
    suite = Suite.model_validate({"name": "s", "sigmas": (0.1,), "seeds": 1} | usual | change)
    with pytest.raises(UserError, match=re.escape(said)):
        _plugin_places([suite])


def entry(name: str, label: str) -> dict[str, str]:
    return {"name": name, "label": label}


def suite_of(*files: Path) -> Suite:
    usual = {"scenarios": ("two_player",), "sensors": ("full",), "sigmas": (0.1,), "seeds": 1}
    estimators = [entry("uniform", "u"), *(entry(f"{f}:Drawn", str(f)) for f in files)]
    return Suite.model_validate({"name": "s", "estimators": estimators} | usual)


def test_plugins_of_one_name_go_to_folders_of_their_own(tmp_path: Path) -> None:
    files = [tmp_path / place / "drawn.py" for place in ("a", "b", "c")]
    files += [tmp_path / "drawn_too.py"]
    for file in files:
        file.parent.mkdir(exist_ok=True)
        file.write_text(PLUGIN.replace("from beside import LEAST", "LEAST = 0.5"))
    places = _plugin_places([suite_of(*files[:2]), suite_of(*files)])
    assert list(places.values()) == [
        "plugins/drawn/drawn.py:Drawn",
        "plugins/drawn-2/drawn.py:Drawn",
        "plugins/drawn-3/drawn.py:Drawn",
        "plugins/drawn_too/drawn_too.py:Drawn",
    ]
    assert list(places) == [f"{file}:Drawn" for file in files]


@pytest.mark.parametrize("beyond", [0, 1])
def test_a_submission_has_a_size(tmp_path: Path, monkeypatch, beyond: int) -> None:
    from olne_bench.bench.report.submission import manifest as reading
    from olne_bench.bench.report.submission import pack as packing

    (tmp_path / "a").write_bytes(b"x" * 60)
    (tmp_path / "b").mkdir()
    (tmp_path / "b/c").write_bytes(b"x" * (40 + beyond))
    monkeypatch.setattr(packing, "MOST_BYTES", 100)
    monkeypatch.setattr(reading, "MOST_BYTES", 100)
    if beyond:
        with pytest.raises(UserError, match="would have 101 bytes, at most 100 are allowed"):
            packing._write_manifest("mine", [], tmp_path)
        monkeypatch.setattr(packing, "MOST_BYTES", 101)
    packing._write_manifest("mine", [], tmp_path)
    files = manifest(tmp_path)["files"]
    assert list(files) == ["a", "b/c"]
    found = reading.Submission(tmp_path, "mine", (), files)
    if beyond:
        with pytest.raises(UserError, match="its files have 101 bytes; at most 100 are allowed"):
            reading._check_files(found)
    else:
        reading._check_files(found)


def verdict(**changes: object) -> Verdict:
    return Verdict(
        **{"rows": 9, "identical": 1, "differing": [], "timed_out": 0}
        | {"other_versions": 0, "because": "", "fresh": [], "unjudged": []}
        | changes
    )


def test_a_verdict_needs_something_that_speaks_for_it_and_nothing_against() -> None:
    fair = FreshErrors("e", "m", 9, 1.0, 1.0, 0.5, decides=True)
    few, bad = replace(fair, decides=False), replace(fair, p=1e-9)
    for accepted in (
        verdict(),
        verdict(fresh=[fair]),
        verdict(identical=0, fresh=[few, fair]),
        verdict(fresh=[few], timed_out=3, other_versions=2),
    ):
        assert accepted.accepted
    for refused in (
        verdict(identical=0),
        verdict(identical=0, fresh=[few]),
        verdict(differing=["one"]),
        verdict(unjudged=["one"]),
        verdict(fresh=[fair, bad]),
        verdict(identical=0, fresh=[fair, bad]),
    ):
        assert not refused.accepted


@pytest.mark.parametrize("number", [0, 3, 10, 12])
def test_a_sample_is_drawn_without_repeats_and_in_order(number: int) -> None:
    trials: list[Any] = list(range(10))
    drawn = [_sample(trials, number, np.random.default_rng(seed)) for seed in range(20)]
    for one in drawn:
        assert len(one) == min(number, 10)
        assert one == sorted(set(one))
    if 0 < number < 10:
        assert len(set(map(tuple, drawn))) > 10
        assert set().union(*drawn) == set(range(10))


def test_fresh_trials_are_of_plugins_with_noise_or_a_draw() -> None:
    suite = Suite.model_validate(
        {"name": "s", "seeds": 2, "sigmas": (0.0, 0.1), "sensors": ("full",)}
        | {"scenarios": (entry("two_player", "fixed"), entry("merge", "drawn") | {"family": True})}
        | {"estimators": (entry("uniform", "uniform"), entry("kkt_residual", "k"))}
    )
    trials = list(expand(suite))
    rng = np.random.default_rng(0)
    fresh = _with_fresh_salt(trials, 40, rng)
    assert [t.seed for t in fresh] == list(range(40))
    assert len({t.salt for t in fresh}) == 1
    assert fresh[0].salt not in {t.salt for t in trials}
    assert len(fresh[0].salt) >= 16
    assert _with_fresh_salt(trials, 1, rng)[0].salt != fresh[0].salt
    assert {t.estimator.label for t in fresh} == {"k"}  # the floor has nothing to prove
    kinds = {(t.scenario.label, t.sigma) for t in fresh}
    assert kinds == {("fixed", 0.1), ("drawn", 0.0), ("drawn", 0.1)}
    own = [
        replace(t, estimator=t.estimator.model_copy(update={"name": "a.py"})) for t in trials[:9]
    ]
    fresh = _with_fresh_salt([*trials, *own], 40, rng)
    assert all(t.plugin for t in fresh)
    floors = [t for t in trials if t.estimator.label == "uniform"]
    assert _with_fresh_salt(floors, 5, rng) == []
    still = [t for t in trials if t.sigma == 0 and not t.scenario.family]
    assert _with_fresh_salt(still, 5, rng) == []


def test_columns_are_alike_up_to_the_digits_of_another_library() -> None:
    numbers = pd.Series([1.0, np.nan, 0.0])
    assert _alike(pd.Series([1.0 + 5e-7, np.nan, 0.0]), numbers)
    assert not _alike(pd.Series([1.0 + 5e-6, np.nan, 0.0]), numbers)
    assert not _alike(pd.Series([1.0, 0.0, 0.0]), numbers)
    assert not _alike(pd.Series([1.0, np.nan, 1e-9]), numbers)
    assert _alike(pd.Series(["a", "b"]), pd.Series(["a", "b"]))
    assert not _alike(pd.Series(["a", "c"]), pd.Series(["a", "b"]))
