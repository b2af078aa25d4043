import sqlite3
from contextlib import closing
from dataclasses import replace

import pytest

from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.select import select
from olne_bench.bench.plan.trial import expand
from olne_bench.bench.plan.versions import Versions
from olne_bench.bench.run.provenance import Provenance
from olne_bench.bench.run.resume import pending, progress
from olne_bench.bench.run.store import APPLICATION_ID, FILE_NAME, VERSION, open_store, read_store
from olne_bench.errors import UserError

SOURCE = Provenance("", "{}", "", "", 1, "", {}, "", {})


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


def test_extras_come_back_and_older_stores_have_none(tmp_path, trials):
    with open_store(tmp_path) as store:
        store.add(trials[0], Outcome("ok", extras='{"starts": 3}'))
    connection = sqlite3.connect(tmp_path / FILE_NAME)
    with connection:
        assert connection.execute("SELECT extras FROM trials").fetchall() == [('{"starts": 3}',)]
        connection.execute("ALTER TABLE trials DROP COLUMN extras")
    connection.close()
    with open_store(tmp_path) as store:
        store.add(trials[1], Outcome("ok", extras='{"starts": 4}'))
        found = store.frame()["extras"]
    assert len(found) == 2
    assert list(found.dropna()) == ['{"starts": 4}']


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
    with pytest.raises(UserError, match=rf"newer version.*layout {VERSION + 1}"):
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


def test_damage_is_found_before_anything_is_added(tmp_path, trials):
    with open_store(tmp_path) as store:
        for trial in trials:
            store.add(trial, Outcome("ok", "x" * 5000))
    path = tmp_path / FILE_NAME
    damaged = bytearray(path.read_bytes())
    damaged[4096:8192] = b"x" * 4096
    path.write_bytes(damaged)
    with pytest.raises(UserError, match=r"damaged \(.*it was left as it is"):
        open_store(tmp_path).__enter__()
    assert path.read_bytes() == damaged


def test_a_store_of_layout_1_is_taken_over(tmp_path, trials):
    connection = sqlite3.connect(tmp_path / FILE_NAME)
    key = ("scenario", "view", "sigma", "seed", "estimator", "parameters")
    with connection:
        connection.execute(
            "CREATE TABLE trials (suite TEXT, scenario TEXT, view TEXT, sigma REAL, seed INTEGER, "
            "estimator TEXT, parameters TEXT, count INTEGER, status TEXT, message TEXT, "
            f"weights TEXT, PRIMARY KEY ({', '.join(key)}))"
        )
        connection.execute(
            "INSERT INTO trials VALUES ('quick', 'two_player', 'full', 0.0, 0, 'uniform', '{}', "
            "5, 'ok', '', '[[0.5, 0.5]]')"
        )
        connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        connection.execute("PRAGMA user_version = 1")
    connection.close()
    with read_store(tmp_path) as store:
        (row,) = store.frame().to_dict("records")
        assert (row["count"], row["status"], row["weights"]) == (5, "ok", [[0.5, 0.5]])
        assert pending(trials, store.records()) == trials  # nobody knows which code it was
    with open_store(tmp_path) as store:
        store.add(trials[0], Outcome("ok"))
        assert len(list(store.records())) == 2


def test_rows_of_former_code_are_kept_apart(tmp_path, trials):
    new = trials[0]
    old = replace(new, versions=Versions("a", "b", "c"))
    with open_store(tmp_path) as store:
        store.begin_run(SOURCE, [old])
        store.add(old, Outcome("ok", "old"))
        store.begin_run(SOURCE, [new])
        assert store.frame().empty  # nothing of the present code yet
        store.add(new, Outcome("ok", "new"))
        assert list(store.frame()["message"]) == ["new"]
        assert len(list(store.records())) == 2
        store.begin_run(SOURCE, [old])
        assert list(store.frame()["message"]) == ["old"]
        assert len(store.runs()) == 3


def test_rows_of_former_parameters_are_kept_apart(tmp_path, trials):
    old = trials[0]
    new = replace(old, estimator=old.estimator.model_copy(update={"parameters": {"a": 1.5}}))
    with open_store(tmp_path / "a") as store:
        for trial in (old, new):
            store.begin_run(SOURCE, [trial])
            store.add(trial, Outcome("ok"))
        assert list(store.frame()["parameters"]) == [new.labels["parameters"]]
        assert progress([old], store.records()).done == [old]
    with open_store(tmp_path / "b") as store:
        store.begin_run(SOURCE, [old])
        store.add(old, Outcome("ok"))
        assert progress([new], store.records()).stale == [new]
        with pytest.raises(UserError, match=r"parameters of 'uniform' .* are .*1.5.* there and {}"):
            store.merge(tmp_path / "a" / FILE_NAME)


def test_a_store_of_layout_2_takes_the_parameters_of_its_last_run(tmp_path, trials):
    with open_store(tmp_path) as store:
        for text in ("x", "y"):
            entry = trials[0].estimator.model_copy(update={"parameters": {"a": text}})
            trial = replace(trials[0], estimator=entry)
            store.begin_run(SOURCE, [trial])
            store.add(trial, Outcome("ok", text))
    with closing(sqlite3.connect(tmp_path / FILE_NAME)) as connection, connection:
        names = "scenario, estimator, parameters, estimator_version, scenario_version"
        names += ", scoring_version"
        connection.execute("DROP TABLE current")
        connection.execute(
            f"CREATE TABLE current ({names}, PRIMARY KEY (scenario, estimator, parameters)) "
            "WITHOUT ROWID"
        )
        connection.execute(f"INSERT INTO current SELECT {names} FROM trials ORDER BY run DESC")
        connection.execute("PRAGMA user_version = 2")
    with read_store(tmp_path) as store:
        assert list(store.frame()["message"]) == ["y"]


@pytest.mark.parametrize("writable", [True, False])
def test_reading_leaves_a_folder_as_it_is(tmp_path, trials, monkeypatch, writable):
    with open_store(tmp_path) as store:
        store.add(trials[0], Outcome("ok"))
    monkeypatch.setattr("os.access", lambda *_: writable)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(UserError, match="readonly"), read_store(tmp_path) as store:
        assert len(store.frame()) == 1
        store.add(trials[0], Outcome("ok"))
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_there_is_no_run_in_a_file_or_an_empty_store(tmp_path):
    (tmp_path / FILE_NAME).touch()
    with pytest.raises(UserError, match=r"its trials\.sqlite is empty"):
        read_store(tmp_path).__enter__()
    with pytest.raises(UserError, match="it is a file; name the run's folder"):
        read_store(tmp_path / FILE_NAME).__enter__()


def test_content_that_cannot_be_read_is_one_line(tmp_path, trials):
    with open_store(tmp_path) as store:
        store.begin_run(SOURCE, trials[:1])
        store.add(trials[0], Outcome("ok", weights=[[0.5, 0.5]]))
    change(tmp_path, "UPDATE runs SET provenance = json_set(provenance, '$.later', 1)")
    with read_store(tmp_path) as store:
        assert store.runs() == [SOURCE]  # a later version knows more
    change(tmp_path, "UPDATE runs SET provenance = json_remove(provenance, '$.suite')")
    change(tmp_path, "UPDATE trials SET weights = '[[0.5'")
    with read_store(tmp_path) as store:
        with pytest.raises(UserError, match=r"of its runs cannot be read \(KeyError\('suite'"):
            store.runs()
        with pytest.raises(UserError, match="weights that cannot be read"):
            store.frame()


def change(folder, statement):
    with closing(sqlite3.connect(folder / FILE_NAME)) as connection, connection:
        connection.execute(statement)
