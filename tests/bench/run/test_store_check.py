"""Of a store with another byte in it, commands say what they said before, or what is wrong."""

import io
import random
import shutil
import sqlite3
from contextlib import closing, redirect_stderr, redirect_stdout

import pandas as pd
import pytest

from olne_bench.bench.commands.cli import main
from olne_bench.bench.run.store import read_store
from olne_bench.bench.run.store_check import Checksums, as_stored, checksum
from olne_bench.bench.run.store_layout import COLUMNS, FILE_NAME
from olne_bench.errors import UserError

GATE = "\n[gate.uniform]\nfailures = 0\n"

#: All that read a store; the first ones are fast where it is whole.
FAST = ("status", "merge")
COMMANDS = (*FAST, "run", "report", "compare", "gate", "submit")


class Run:
    """A finished run, and what commands say of it and of changed copies."""

    def __init__(self, study):
        self.study, self.folder = study, study.folder / "out"
        study.suite.write_text(study.suite.read_text() + GATE)
        study.run("out", "Drawn")
        self.whole = (self.folder / FILE_NAME).read_bytes()
        shutil.copytree(self.folder, study.folder / "intact")
        self.usual = {command: self.say(command) for command in FAST}
        assert {code for code, _ in self.usual.values()} == {0}
        with read_store(study.folder / "intact") as store:
            self.metrics = sorted({*store.table().column_names} - {*COLUMNS})

    def arguments(self, command):
        folder = self.study.folder
        return {
            "compare": ["compare", self.folder, folder / "intact"],
            "merge": ["merge", folder / "intact", self.folder, "--out", folder / "merged"],
            "run": self.study.arguments("out", "Drawn"),
            "report": ["report", self.folder, "--no-figures"],
            "submit": ["submit", self.folder, "--out", folder / "submitted"],
        }.get(command, [command, self.folder])

    def say(self, command):
        """Exit code of a command, and what it prints."""
        for made in ("merged", "submitted"):
            shutil.rmtree(self.study.folder / made, ignore_errors=True)
        said, code = io.StringIO(), 0
        with redirect_stdout(said), redirect_stderr(said):
            try:
                main([*map(str, self.arguments(command))])
            except SystemExit as error:
                code = int(error.code or 0)
        return code, said.getvalue()

    def write(self, content):
        for path in self.folder.glob(f"{FILE_NAME}*"):
            path.unlink()
        (self.folder / FILE_NAME).write_bytes(content)

    def change(self, statement):
        """Change the copy by SQL, without new checksums."""
        with closing(sqlite3.connect(self.folder / FILE_NAME)) as connection, connection:
            assert connection.execute(statement).rowcount


@pytest.fixture(scope="module")
def run(lasting_study):
    return Run(lasting_study)


def refusal(said):
    code, text = said
    assert code == 2
    assert text.startswith("olne-bench: error: ") and text.endswith("\n")
    line = text[:-1]
    assert line.isprintable() and FILE_NAME in line
    return line


def test_any_other_byte_is_noticed_or_changes_nothing(run):
    rng, refused = random.Random(0), 0
    table = run.study.rows("intact")
    for place in rng.sample(range(len(run.whole)), 40):
        other = bytearray(run.whole)
        other[place] ^= rng.randrange(1, 256)
        for command in FAST:
            run.write(bytes(other))
            said = run.say(command)
            if said != run.usual[command]:
                refusal(said)
                refused += 1
        try:
            pd.testing.assert_frame_equal(run.study.rows("out"), table, check_exact=True)
        except UserError as error:
            assert str(error).isprintable() and FILE_NAME in str(error)
    assert refused > 8


#: Changes of one row by SQL, and what is said of it.
CHANGES = {
    "status = 'fine'": "status 'fine' is none of ok, not_converged, failed_forward",
    "status = NULL": "it has no status",
    "position_error = 'much'": "position_error is 'much', not a number",
    "position_error = position_error + 1": "its values differ from its checksum",
    "message = NULL": "it has no message",
    "message = CAST(x'ff41' AS TEXT)": r"message is '\udcffA', which is no text in UTF-8",
    "extras = x'00'": r"extras is b'\x00', not a text",
    "weights = '[[0.5'": "weights are '[[0.5', no table of numbers",
    "weights = '[[1, 2], [3]]'": "weights are '[[1, 2], [3]]', no table of numbers",
    "weights = '[[0.5, 0.5]]'": "weights are 1 x 2 numbers, where others of its draw are 2 x 4",
    "checksum = NULL": "its values differ from its checksum",
}
ROW = "estimator = 'uniform' AND sigma = 0.1 AND seed = 2"


@pytest.mark.parametrize("change", CHANGES)
def test_a_row_that_cannot_be_is_named(run, change):
    run.write(run.whole)
    run.change(f"UPDATE trials SET {change} WHERE {ROW}")
    if "status" not in change:
        assert run.say("status") == run.usual["status"]  # it has not read the rest
    line = refusal(run.say("gate"))
    assert "trials.sqlite is damaged: row " in line
    assert f"(uniform, two_player, full, sigma 0.1, seed 2): {CHANGES[change]}" in line
    assert line.endswith("restore it from a copy, or move it away and run again")


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("change", ["trials SET status = 'fine'", "runs SET provenance = '{}'"])
def test_all_commands_name_what_is_damaged(run, command, change):
    run.write(run.whole)
    run.change(f"UPDATE {change}")
    assert "is damaged" in refusal(run.say(command))


#: Changes of other tables, and of what SQLite says of them.
OTHER_TABLES = {
    "UPDATE runs SET provenance = provenance || ' '": "row 1 of its table 'runs'",
    "UPDATE current SET estimator_version = 'a'": "row 1 of its table 'current'",
    "UPDATE costs SET seconds = 2 * seconds": "row 1 of its table 'costs'",
    "UPDATE metrics SET checksum = 1": "row 1 of its table 'metrics'",
    "DELETE FROM metrics WHERE name = 'crps'": "its table 'trials' has other columns",
    "ALTER TABLE trials RENAME COLUMN crps TO crpt": "its table 'trials' has other columns",
    "ALTER TABLE trials RENAME COLUMN status TO state": "its table 'trials' has other columns",
    "DROP TABLE costs": "its table 'costs' has other columns",
}


@pytest.mark.parametrize("change", OTHER_TABLES)
def test_damage_in_another_table_is_named(run, change):
    run.write(run.whole)
    run.change(change)
    assert f"is damaged ({OTHER_TABLES[change]}" in refusal(run.say("status"))


def test_a_status_of_a_writer_that_knows_more_is_refused(run):
    """The checksum is right, so it is the word that is not known."""
    columns = ", ".join(f'"{name}"' for name in (*COLUMNS, *run.metrics))
    run.write(run.whole)
    run.change(f"UPDATE trials SET status = 'fine' WHERE {ROW}")
    with closing(sqlite3.connect(run.folder / FILE_NAME)) as connection, connection:
        row = connection.execute(f"SELECT {columns} FROM trials WHERE {ROW}").fetchone()
        right = Checksums(run.metrics).of(row)
        connection.execute(f"UPDATE trials SET checksum = ? WHERE {ROW}", [right])
    assert "status 'fine' is none of ok" in refusal(run.say("status"))


def test_metrics_without_a_value_do_not_change_a_checksum():
    row = tuple(range(len(COLUMNS)))
    one = Checksums(["a", "c"]).of((*row, 0.5, None))
    assert one == Checksums(["a", "b", "c"]).of((*row, 0.5, None, None))
    assert one != Checksums(["a", "c"]).of((*row, None, 0.5))
    assert one != Checksums(["a", "c"]).of((*row, 0.5, 0.5))
    assert one != Checksums(["b", "c"]).of((*row, 0.5, None))


def test_values_are_checked_as_sqlite_gives_them_back():
    given = {"REAL": [1, -0.0, float("nan"), 1e300, None], "INTEGER": [True, 3], "TEXT": ["1"]}
    with closing(sqlite3.connect(":memory:")) as connection:
        for kind, values in given.items():
            connection.execute(f"CREATE TABLE {kind} (value {kind})")
            connection.executemany(f"INSERT INTO {kind} VALUES (?)", [(v,) for v in values])
            back = [value for (value,) in connection.execute(f"SELECT value FROM {kind}")]
            assert list(map(repr, back)) == [repr(as_stored(v, kind)) for v in values]
            assert checksum(*back) == checksum(*(as_stored(v, kind) for v in values))
