import sqlite3
from contextlib import closing
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest

from olne_bench.bench.plan.entries import MetricEntry
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.select import Selection, select
from olne_bench.bench.plan.trial import expand
from olne_bench.bench.plan.versions import Versions
from olne_bench.bench.run import store as store_module
from olne_bench.bench.run.provenance import Provenance
from olne_bench.bench.run.resume import Stored, pending
from olne_bench.bench.run.store import MESSAGE_SIZE, open_store, read_store
from olne_bench.bench.run.store_check import checksum
from olne_bench.bench.run.store_layout import FILE_NAME, VERSION
from olne_bench.errors import UserError

SOURCE = Provenance("", "{}", "", Selection(), 1, "", {}, {}, "", {})


@pytest.fixture
def trials():
    part = select(
        load_suite("paper"), Selection(scenarios=("two_player",), estimators=("uniform",))
    )
    return list(expand(part, seeds=2))


def test_rows_come_back(tmp_path, trials):
    outcome = Outcome(
        "ok", "fine", extras='{"a": 1}', scores={"cosine_error": 0.1}, weights=[[0.25] * 4] * 2
    )
    with open_store(tmp_path) as store:
        store.add(trials[0], outcome)
    with read_store(tmp_path) as store:
        frame = store.frame()
        assert store.records() == {(*trials[0].cell, *trials[0].code): {trials[0].seed: "ok"}}
    row = frame.iloc[0]
    assert row["weights"] == [[0.25] * 4] * 2
    assert (row["status"], row["message"], row["cosine_error"]) == ("ok", "fine", 0.1)
    assert np.isnan(row["position_error"])
    assert row["extras"] == '{"a": 1}'
    assert row["count"] == 40


def test_order_does_not_depend_on_when_rows_were_written(tmp_path, trials):
    for name, order in (("a", trials), ("b", trials[::-1])):
        with open_store(tmp_path / name) as store:
            for trial in order:
                store.add(trial, Outcome("ok"))
    with read_store(tmp_path / "a") as a, read_store(tmp_path / "b") as b:
        assert a.frame().equals(b.frame())


def test_batches_are_the_table_in_parts(tmp_path, trials, monkeypatch):
    with open_store(tmp_path) as store:
        for trial in trials:
            store.add(trial, Outcome("ok", weights=[[0.5, 0.5]]))
        monkeypatch.setattr(store_module, "_BATCH", 2)
        batches = list(store.batches())
        assert [len(batch) for batch in batches] == [2] * (len(trials) // 2) + [1] * (
            len(trials) % 2
        )
        assert pa.Table.from_batches(batches).equals(store.table())


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


@pytest.mark.parametrize(
    ("layout", "expected"),
    [
        (VERSION + 1, f"a newer version.*layout {VERSION + 1}"),
        (VERSION - 1, f"an unreleased version.*layout {VERSION - 1}"),
    ],
)
def test_a_store_of_another_layout_is_refused(tmp_path, trials, layout, expected):
    with open_store(tmp_path) as store:
        store.add(trials[0], Outcome("ok"))
    connection = sqlite3.connect(tmp_path / FILE_NAME)
    connection.execute(f"PRAGMA user_version = {layout}")
    connection.close()
    for opened in (open_store, read_store):
        with pytest.raises(UserError, match=expected):
            opened(tmp_path).__enter__()


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


def test_rows_of_former_code_are_kept_apart(tmp_path, trials):
    new = trials[0]
    old = replace(new, versions=Versions("a", "b", "c", "d", "e"))
    with open_store(tmp_path) as store:
        store.begin_run(SOURCE, [old])
        store.add(old, Outcome("ok", "old"))
        store.begin_run(SOURCE, [new])
        assert store.frame().empty  # nothing of the present code yet
        store.add(new, Outcome("ok", "new"))
        assert list(store.frame()["message"]) == ["new"]
        assert sum(map(len, store.records().values())) == 2
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
        assert Stored(store.records()).state(old) == "done"
    with open_store(tmp_path / "b") as store:
        store.begin_run(SOURCE, [old])
        store.add(old, Outcome("ok"))
        assert Stored(store.records()).state(new) == "stale"
        with pytest.raises(UserError, match=r"parameters of 'uniform' .* are .*1.5.* there and {}"):
            store.merge(tmp_path / "a" / FILE_NAME)


@pytest.mark.parametrize("lost", [1, 100, 4096, 5000, 20_000])
def test_a_store_that_lost_its_end_is_reported(tmp_path, trials, lost):
    with open_store(tmp_path) as store:
        for trial in trials:
            store.add(trial, Outcome("ok", "x" * 1000))
    path = tmp_path / FILE_NAME
    left = path.read_bytes()[:-lost]
    path.write_bytes(left)
    for opened in (open_store, read_store):
        with pytest.raises(UserError, match=r"damaged \(it has \d+ bytes instead of \d+\)"):
            opened(tmp_path).__enter__()
    assert path.read_bytes() == left


def test_a_store_in_use_is_read(tmp_path, trials):
    with open_store(tmp_path) as store:
        store.add(trials[0], Outcome("ok"))
        with read_store(tmp_path) as reader:
            assert len(reader.frame()) == 1


def test_messages_are_cut(tmp_path, trials):
    with open_store(tmp_path) as store:
        for trial, letter in zip(trials, "aä€", strict=False):
            store.add(trial, Outcome("crash", letter * 30_000_000))
        found = store.frame()["message"]
    assert {message[0] for message in found} == set("aä€")
    for message in found:
        assert MESSAGE_SIZE - 5 < len(message.encode()) <= MESSAGE_SIZE
        assert message.endswith("...")


def test_a_metric_has_a_column_as_soon_as_a_run_has_it(tmp_path, trials):
    former = replace(trials[0], metrics=trials[0].metrics[:1])
    more = MetricEntry(name="mine.py", column="mine")
    later = replace(trials[1], metrics=(*former.metrics, more))
    own = former.metrics[0].column
    with open_store(tmp_path / "a") as store:
        store.begin_run(SOURCE, [former])
        store.add(former, Outcome("ok", scores={own: 0.5}))
        before = list(store.frame())
    with open_store(tmp_path / "a") as store:
        store.begin_run(SOURCE, [former, later])
        store.add(later, Outcome("ok", scores={own: 0.25, "mine": 2.0}))
        assert list(store.frame()["mine"].dropna()) == [2.0]
        assert list(store.frame()) == [*before, "mine"]
    with open_store(tmp_path / "b") as store:
        store.add(former, Outcome("ok", scores={own: 0.5}))
        assert store.merge(tmp_path / "a" / FILE_NAME) == (1, 1)
        assert store.frame()[[own, "mine"]].dropna().to_numpy().tolist() == [[0.25, 2.0]]


def test_merging_names_what_differs_in_the_environment(tmp_path, trials):
    trial = trials[0]
    for name, version in (("a", "2.3"), ("b", "2.4")):
        with open_store(tmp_path / name) as store:
            versions = replace(trial.versions, environment=name)
            source = replace(SOURCE, environment={"numpy": version, "backend": "native"})
            store.begin_run(source, [replace(trial, versions=versions)])
    expected = r"environment version of 'uniform' on 'two_player', 'full', is b there and a here "
    with open_store(tmp_path / "a") as store, pytest.raises(UserError) as caught:
        store.merge(tmp_path / "b" / FILE_NAME)
    assert expected + "(numpy 2.4 there, 2.3 here); run one" in str(caught.value)


def test_faults_of_the_harness_are_kept_apart(trials):
    statuses = ("ok", "skipped", "crash", "harness_error")
    records = {}
    for trial, status in zip(trials, statuses, strict=False):
        records.setdefault((*trial.cell, *trial.code), {})[trial.seed] = status
    stored = Stored(records)
    states = [stored.state(trial) for trial in trials[:5]]
    assert states == ["done", "done", "failed", "harness_error", "missing"]
    for retry, expected in (((), []), (("failed",), [2]), (("harness_error", "crash"), [2, 3])):
        todo = list(pending(trials, stored, retry))
        assert todo == [*(trials[k] for k in expected), *trials[4:]]


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


def test_a_reader_sees_what_is_added_while_it_reads(tmp_path, trials):
    with open_store(tmp_path) as store:
        store.add(trials[0], Outcome("ok"))
    with read_store(tmp_path) as reader:
        assert len(reader.frame()) == 1
        with open_store(tmp_path) as store:
            store.add(trials[1], Outcome("ok"))
        assert len(reader.frame()) == 2


def test_a_folder_that_cannot_be_written_is_read_without_a_note_beside_it(
    tmp_path, trials, monkeypatch
):
    with open_store(tmp_path) as store:
        store.add(trials[0], Outcome("ok"))
    before = {path.name for path in tmp_path.iterdir()}
    monkeypatch.setattr("os.access", lambda *_: False)
    with read_store(tmp_path) as reader:
        assert len(reader.frame()) == 1
        assert {path.name for path in tmp_path.iterdir()} == before


def test_there_is_no_run_in_a_file_or_an_empty_store(tmp_path):
    (tmp_path / FILE_NAME).touch()
    with pytest.raises(UserError, match=r"its trials\.sqlite is empty"):
        read_store(tmp_path).__enter__()
    with pytest.raises(UserError, match="it is a file; name the run's folder"):
        read_store(tmp_path / FILE_NAME).__enter__()


def test_what_runs_say_may_be_of_a_later_version(tmp_path, trials):
    with open_store(tmp_path) as store:
        store.begin_run(SOURCE, trials[:1])
    for made in ("json_set(provenance, '$.later', 1)", "json_remove(provenance, '$.suite')"):
        change(tmp_path, f"UPDATE runs SET provenance = {made}")
        change(tmp_path, "UPDATE runs SET checksum = checksum(provenance)")
        with read_store(tmp_path) as store:
            if "later" in made:
                assert store.runs() == [SOURCE]
                continue
            with pytest.raises(UserError, match=r"of its runs cannot be read \(KeyError\('suite'"):
                store.runs()


def change(folder, statement):
    with closing(sqlite3.connect(folder / FILE_NAME)) as connection, connection:
        connection.create_function("checksum", -1, checksum)
        connection.execute(statement)
