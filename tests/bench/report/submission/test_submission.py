"""Submissions: packed, verified, and refused if anything has changed."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq
import pytest

from olne_bench.bench.commands.cli import main
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.report.submission.manifest import MANIFEST, ROWS, digest, read_submission
from olne_bench.bench.report.submission.pack import _plugin_places
from olne_bench.bench.report.submission.verify import _away_from_rows
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

        for cached in (fingerprint._content, fingerprint._tree, versions._version):
            cached.cache_clear()
        assert "6 of 12 trials in" in (told := refused(run, "--name", "x", "--out", new))
        assert "other code than the present one" in told
    finally:
        helper.write_text(text)
        for cached in (fingerprint._content, fingerprint._tree, versions._version):
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
