import sqlite3

import pytest

from bench.errors import UserError
from bench.store import FILE_NAME, VERSION, open_store, read_store
from bench.suite import load_suite, select
from bench.trial import Outcome, expand


@pytest.fixture
def trials():
    part = select(load_suite("quick"), scenarios=("two_player",), estimators=("uniform",))
    return list(expand(part, seeds=2))


def test_rows_come_back(tmp_path, trials):
    outcome = Outcome("ok", "fine", cosine_error=0.1, weights=[[0.25] * 4] * 2)
    with open_store(tmp_path) as store:
        store.add(trials[0], outcome)
    with read_store(tmp_path) as store:
        frame = store.frame()
        assert [r.key for r in store.records()] == [trials[0].key]
    row = frame.iloc[0]
    assert row["weights"] == [[0.25] * 4] * 2
    assert (row["status"], row["message"], row["cosine_error"]) == ("ok", "fine", 0.1)
    assert row["count"] == 5


def test_order_does_not_depend_on_when_rows_were_written(tmp_path, trials):
    for name, order in (("a", trials), ("b", trials[::-1])):
        with open_store(tmp_path / name) as store:
            for trial in order:
                store.add(trial, Outcome("ok"))
    with read_store(tmp_path / "a") as a, read_store(tmp_path / "b") as b:
        assert a.frame().equals(b.frame())


def test_a_second_writer_is_refused(tmp_path):
    with open_store(tmp_path), pytest.raises(UserError, match="another run is writing"):
        open_store(tmp_path).__enter__()


def test_a_foreign_file_is_refused_and_left_alone(tmp_path):
    path = tmp_path / FILE_NAME
    path.write_bytes(b"not a database at all" * 100)
    before = path.read_bytes()
    with pytest.raises(UserError, match="not a store of this benchmark"):
        open_store(tmp_path).__enter__()
    assert path.read_bytes() == before


def test_another_programs_database_is_refused_and_left_alone(tmp_path):
    path = tmp_path / FILE_NAME
    connection = sqlite3.connect(path)
    connection.execute("CREATE TABLE trials (a)")
    connection.close()
    before = path.read_bytes()
    with pytest.raises(UserError, match="not a store of this benchmark"):
        open_store(tmp_path).__enter__()
    assert path.read_bytes() == before


def test_a_newer_store_is_refused(tmp_path, trials):
    with open_store(tmp_path) as store:
        store.add(trials[0], Outcome("ok"))
    connection = sqlite3.connect(tmp_path / FILE_NAME)
    connection.execute(f"PRAGMA user_version = {VERSION + 1}")
    connection.close()
    with pytest.raises(UserError, match=f"layout {VERSION + 1}"):
        open_store(tmp_path).__enter__()


def test_a_truncated_store_is_reported(tmp_path, trials):
    with open_store(tmp_path) as store:
        for trial in trials:
            store.add(trial, Outcome("ok", "x" * 2000))
    path = tmp_path / FILE_NAME
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(UserError, match="damaged"), read_store(tmp_path) as store:
        store.frame()


def test_no_run_is_reported(tmp_path):
    with pytest.raises(UserError, match="no run in"):
        read_store(tmp_path).__enter__()


def test_a_file_is_no_folder(tmp_path):
    path = tmp_path / "file"
    path.write_text("")
    with pytest.raises(UserError, match="it is a file"):
        open_store(path).__enter__()
