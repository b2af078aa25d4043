"""Submissions: packed, verified, and refused if anything has changed."""

import json
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow.parquet as pq
import pytest

from olne_bench.bench.commands.cli import main
from olne_bench.bench.plan import fingerprint, versions
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.plan.versions import Versions, environment_version
from olne_bench.bench.report.confirmations import Confirmation
from olne_bench.bench.submission.again import Repeated
from olne_bench.bench.submission.boards import board_files
from olne_bench.bench.submission.drawn import DrawnErrors
from olne_bench.bench.submission.files import digest
from olne_bench.bench.submission.fresh import FreshErrors
from olne_bench.bench.submission.manifest import MANIFEST, PLUGINS, ROWS, read_submission
from olne_bench.bench.submission.pack import _copy_plugins, _plugin_places
from olne_bench.bench.submission.played import played_study
from olne_bench.bench.submission.rows import read_rows
from olne_bench.bench.submission.verify import Verdict, plugins_alone
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


@contextmanager
def edited(folder: Path) -> Iterator[dict]:
    """Its manifest, to change."""
    data = manifest(folder)
    yield data
    (folder / MANIFEST).write_text(json.dumps(data))


def sign(folder: Path) -> None:
    """Update the manifest to the present files, as a forger would."""
    with edited(folder) as data:
        data["files"] = {place: digest((folder / place).read_bytes()) for place in data["files"]}


def change_rows(folder: Path, change: Callable[[pd.DataFrame], pd.DataFrame]) -> None:
    table = pq.read_table(folder / ROWS)
    frame = change(table.to_pandas())
    pq.write_table(table.schema.empty_table().from_pandas(frame, table.schema), folder / ROWS)
    sign(folder)


def other_libraries(folder: Path) -> None:
    """Manifest and rows as if an older NumPy had been there."""
    with edited(folder) as data:
        libraries = data["runs"][0]["environment"]
        libraries["numpy"] = "1.0"
    version = environment_version(libraries)
    change_rows(folder, lambda rows: rows.assign(environment_version=version))


def make_boards(folder: Path) -> None:
    """Tables that follow from the rows, as a forger would make them."""
    found = read_submission(folder)
    study = played_study(found.suites(folder / PLUGINS))
    for name, text in board_files(read_rows(found).table, study).items():
        (folder / name).write_text(text, newline="")
    sign(folder)


def verify(folder: Path, *options: object) -> int:
    return call("verify", folder, "--seed", "1", "--jobs", "2", *options)


@pytest.fixture(autouse=True)
def fewer(monkeypatch) -> None:
    """Fewer fresh trials: ``test_fresh`` has their number."""
    for name in ("FIRST", "SECOND"):
        monkeypatch.setattr(f"olne_bench.bench.submission.verify.{name}", 10)
    monkeypatch.setattr("olne_bench.bench.submission.drawn.PAIRS", 3)


def test_what_is_packed_is_accepted_and_holds_all_that_is_needed(packed: Path, capsys) -> None:
    places = {p.relative_to(packed).as_posix() for p in packed.rglob("*") if p.is_file()}
    assert places == {
        *("leaderboard.csv", "leaderboard.md", "submission.json", "trials.parquet"),
        *("plugins/drawn/beside.py", "plugins/drawn/drawn.py"),
    }
    text = (packed / MANIFEST).read_text()
    assert str(packed.parent) not in text  # this folder exists only here
    assert json.loads(manifest(packed)["runs"][0]["suite"])["salt"] == "tiny"
    assert verify(packed) == 0
    said = capsys.readouterr().out
    assert "12 of 12 rows run again are the same, bit by bit" in said
    assert "fresh salt  Drawn: " in said
    assert "drawn truths  Drawn in two_player: " in said
    assert "NOT RANKABLE  fixed truths, which everyone can look up: two_player" in said
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


def worse_rival(rows: pd.DataFrame) -> pd.DataFrame:
    rows.loc[rows["estimator"] == "uniform", "position_error"] += 5.0
    return rows


def test_other_versions_do_not_hide_a_rival_made_worse(submission: Path, capsys) -> None:
    change_rows(submission, worse_rival)
    make_boards(submission)
    kept = (submission / ROWS).read_bytes()
    change_rows(submission, lambda rows: rows.assign(environment_version="0123456789ab"))
    assert verify(submission) == 2
    assert "environment_version of uniform, two_player, full" in capsys.readouterr().err
    # Nor does a manifest that lists the same.
    (submission / ROWS).write_bytes(kept)
    other_libraries(submission)
    assert verify(submission, "--strict") == 2
    assert "its rows are of other versions: numpy 1.0 there," in capsys.readouterr().err
    assert verify(submission) == 1
    said = capsys.readouterr().out
    assert "of other versions, compared within 0.1 %: numpy 1.0 there" in said
    assert "DIFFERS  uniform, two_player, full" in said


CONSTANTS = """
from types import SimpleNamespace

import numpy as np


class Constants:
    name = "constants"

    def estimate(self, problem, observation, *, rng, budget):
        return SimpleNamespace(weights=np.full((2, 4), 0.25))
"""


def test_whoever_returns_the_published_weights_is_refused(tmp_path: Path, capsys) -> None:
    (tmp_path / "constants.py").write_text(CONSTANTS)
    suite = SUITE.replace("0.01, 0.1", "0.05, 0.1")
    (tmp_path / "tiny.toml").write_text(suite.replace("uniform", "kkt_constrained"))
    words = [tmp_path / "tiny.toml", "--plugin", tmp_path / "constants.py", "--no-figures"]
    assert call("run", *words, "--out", tmp_path / "run") == 0
    assert call("submit", tmp_path / "run", "--out", tmp_path / "packed") == 0
    assert verify(tmp_path / "packed") == 1
    said = capsys.readouterr().out
    assert "KNOWS THE TRUTH  constants in two_player: median error" in said
    assert "refused" in said


def test_a_plugin_does_not_find_its_rows_nor_who_runs_it(packed: Path) -> None:
    submission = read_submission(packed)
    with plugins_alone(submission) as home:
        found = {p.relative_to(home).as_posix() for p in home.rglob("*") if p.is_file()}
        assert found == {"drawn/beside.py", "drawn/drawn.py"}
        assert not home.is_relative_to(packed)
        for word in ("olne", "verify", "submission", "plugins"):
            assert word not in str(home)
        (suite,) = submission.suites(home)
        assert suite.estimators[-1].name == f"{home}/drawn/drawn.py"
        started = datetime.fromisoformat(submission.runs[0].started).timestamp()
        assert {(home / place).stat().st_mtime for place in found} == {started}
    assert not home.exists()
    undated = replace(submission, runs=(replace(submission.runs[0], started="9" * 5000),))
    with plugins_alone(undated) as home:
        assert (home / "drawn/drawn.py").exists()


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
    with edited(folder) as data:
        del data["files"]["plugins/drawn/drawn.py"]
    (folder / "plugins/drawn/drawn.py").unlink()


def ask_for_more(folder: Path) -> None:
    with edited(folder) as data:
        run = data["runs"][0]
        run["seeds"] = 10**8
        run["suite"] = run["suite"].replace('"seeds":3', f'"seeds":{10**8}')


def twice(rows: pd.DataFrame) -> pd.DataFrame:
    return pd.concat([rows, rows.iloc[:1]], ignore_index=True)


def reshaped(rows: pd.DataFrame) -> pd.DataFrame:
    return rows.assign(weights=[[[0.5], [0.5], [1.0]]] * len(rows))


def edit_text(folder: Path) -> None:
    text = folder / "leaderboard.md"
    text.write_text(text.read_text().replace("Drawn", "Best"))
    sign(folder)


def leave_folder(folder: Path) -> None:
    with edited(folder) as data:
        data["files"]["../outside.py"] = "0"


def link_elsewhere(folder: Path) -> None:
    plugins = folder / "plugins"
    plugins.rename(folder.parent / "elsewhere")
    plugins.symlink_to(folder.parent / "elsewhere")


@pytest.mark.parametrize(
    ("harm", "said"),
    [
        (lambda f: change_rows(f, lambda r: r[1:]), "suite 'tiny' asks for 12 trials, and there"),
        (lambda f: change_rows(f, twice), "has 1 trials more than once"),
        (edit_plugin, "plugins/drawn/drawn.py was changed after it was submitted"),
        (edit_table, "is not the leaderboard of the rows beside it: see cosine_error_median"),
        (edit_text, "leaderboard.md is not the leaderboard of the rows beside it"),
        (lambda f: (f / "more.txt").touch(), "'more.txt' is not listed in submission.json; re"),
        (ask_for_more, f"asks for {4 * 10**8} trials, and there are 12 rows"),
        (lambda f: change_rows(f, reshaped), "no table can be made of its rows: cannot reshap"),
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


def forget() -> None:
    """Contents of files are cached within a process."""
    for cached in (fingerprint._content, fingerprint._summary, versions._version):
        cached.cache_clear()


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
        forget()
        assert "6 of 12 trials in" in (told := refused(run, "--name", "x", "--out", new))
        assert "other code than the present one" in told
    finally:
        helper.write_text(text)
        forget()
    assert not new.exists()


def entry(name: str, label: str) -> dict[str, str]:
    return {"name": name, "label": label}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"sensors": ("mine.py:Sensor",)}, "mine.py:Sensor is a plugin that others' estimators"),
        ({"scenarios": ("mine.py",)}, "a submission brings estimators"),
        ({"metrics": ("mine.py",)}, "a submission brings estimators"),
        ({"estimators": ("installed",)}, "run it from its file, with --plugin FILE.py"),
        ({"estimators": (entry("uniform", "map"),)}, "an estimator is labelled 'map' and is not"),
    ],
)
def test_a_submission_brings_estimators_in_files(change: dict[str, tuple], said: str) -> None:
    usual = {"scenarios": ("two_player",), "sensors": ("full",), "estimators": ("uniform",)}
    suite = Suite.model_validate({"name": "s", "sigmas": (0.1,), "seeds": 1} | usual | change)
    with pytest.raises(UserError, match=re.escape(said)):
        _plugin_places([suite])


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


def test_what_a_link_leads_to_is_not_packed(tmp_path: Path) -> None:
    plugin = tmp_path / "mine" / "drawn.py"
    plugin.parent.mkdir()
    plugin.write_text(PLUGIN.replace("from beside import LEAST", "LEAST = 0.5"))
    (tmp_path / "key").write_text("secret")
    plugin.with_suffix(".key").symlink_to(tmp_path / "key")
    with pytest.raises(UserError, match="is a link out of its folder"):
        _copy_plugins({f"{plugin}:Drawn": "plugins/drawn/drawn.py"}, tmp_path / "out")


@pytest.mark.parametrize("beyond", [0, 1])
def test_a_submission_has_a_size(tmp_path: Path, monkeypatch, beyond: int) -> None:
    from olne_bench.bench.submission import pack as packing

    (tmp_path / "a").write_bytes(b"x" * 60)
    (tmp_path / "b").mkdir()
    (tmp_path / "b/c").write_bytes(b"x" * (40 + beyond))
    monkeypatch.setattr(packing, "MOST_BYTES", 100)
    if beyond:
        with pytest.raises(UserError, match="would have 101 bytes, at most 100 are allowed"):
            packing._write_manifest("mine", [], tmp_path)
        return
    packing._write_manifest("mine", [], tmp_path)
    assert list(manifest(tmp_path)["files"]) == ["a", "b/c"]
    monkeypatch.setattr(packing, "MOST_FILES", 1)
    (tmp_path / MANIFEST).unlink()
    with pytest.raises(UserError, match="would have 2 files, at most 1 are allowed"):
        packing._write_manifest("mine", [], tmp_path)


def test_a_submission_has_a_number_of_rows(run: Path, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr("olne_bench.bench.submission.pack.MOST_ROWS", 11)
    assert call("submit", run, "--name", "a", "--out", tmp_path / "a") == 2
    assert "has 12 rows, at most 11 are allowed" in capsys.readouterr().err


def verdict(**changes: Any) -> Verdict:
    return Verdict(**{"rows": 9, "repeated": Repeated(same=1)} | changes)


def test_a_verdict_needs_something_that_speaks_for_it_and_nothing_against() -> None:
    fair = FreshErrors("e", "m", 9, 1.0, 1.0, 0.5, decides=True)
    few, bad = replace(fair, decides=False), replace(fair, p=1e-9)
    able = DrawnErrors("e", "s", 9, 1.0, 2.0, 0.1, 0.1)
    seen = Confirmation(
        "s", "full", "e", "", Versions(), (0.1,), 3, 20, "m", 0.1, 0.1, 9, confirmed=True
    )
    for accepted in (
        verdict(),
        verdict(fresh=[fair], drawn=[able], fixed=("s",), implausible=[seen]),
        verdict(repeated=Repeated(same=1, silent=3), because="numpy"),
    ):
        assert accepted.accepted
    for refused in (
        verdict(repeated=Repeated()),
        verdict(repeated=Repeated(silent=3), fresh=[fair]),
        verdict(repeated=Repeated(same=5, differing=["one"])),
        verdict(repeated=Repeated(same=20, silent=4)),
        verdict(unjudged=["one"]),
        verdict(implausible=[replace(seen, confirmed=False)]),
        verdict(fresh=[fair, bad]),
        verdict(fresh=[fair, few]),
        verdict(drawn=[able, replace(able, drawn=1e6)]),
    ):
        assert not refused.accepted
