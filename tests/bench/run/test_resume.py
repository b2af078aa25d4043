"""Continued runs: finished trials stay, changed ones are run again, nothing is lost."""

import pandas as pd
import pytest

from olne_bench.bench.plan.suite import read_suite_json, salt_id
from olne_bench.bench.process.sandbox import landlock_version
from olne_bench.bench.run.store import read_store
from olne_bench.bench.run.store_layout import FILE_NAME


def same(a, b):
    pd.testing.assert_frame_equal(a, b, check_exact=True)


def test_a_changed_estimator_is_run_again_and_an_unchanged_one_never(study):
    study.run("out", "Drawn")
    first = study.rows("out")
    study.plugin.write_text("# only a comment\n" + study.plugin.read_text())
    assert "16 of 16 trials are done already" in study.run("out", "Drawn")

    original = study.plugin.read_text()
    study.plugin.write_text(original.replace("rng.uniform(0.5", "rng.uniform(0.9"))
    shown = study.call("status", study.folder / "out")
    assert ["two_player", "Drawn", "0", "0", "0", "8", "0"] in [
        line.split() for line in shown.split("\n")
    ]
    assert "8 of 16 trials are done already" in study.run("out", "Drawn")
    second = study.rows("out")
    assert len(second) == 16
    changed = first["weights"].map(str) != second["weights"].map(str)
    assert (changed == (first["estimator"] == "Drawn")).all()

    study.plugin.write_text(original)  # the former rows are still there
    assert "16 of 16 trials are done already" in study.run("out", "Drawn")
    same(study.rows("out"), first)


def test_two_halves_merged_are_the_whole(study):
    study.run("whole", "Drawn")
    study.run("a", "Drawn", options=("--sigma", "0.01"))
    study.run("b", "Drawn", options=("--sigma", "0.1"))
    a, b, c = (study.folder / name for name in "abc")
    assert "8 rows" in study.call("merge", a, b, "--out", c)
    assert "0 rows" in study.call("merge", c, b)
    same(study.rows("c"), study.rows("whole"))
    with read_store(c) as store:
        assert [str(run.selection) for run in store.runs()][:2] == ["--sigma 0.01", "--sigma 0.1"]

    study.plugin.write_text(study.plugin.read_text().replace("rng.uniform(0.5", "rng.uniform(0.9"))
    study.run("b", "Drawn", options=("--sigma", "0.1"))
    error = study.call("merge", c, b, code=2)
    assert "cannot merge" in error
    assert "estimator version of 'Drawn'" in error


def test_retry_runs_what_failed_and_nothing_else(study):
    said = study.run("out", "Fails")
    assert "crash" in said
    assert "16 of 16 trials are done already" in study.run("out", "Fails")
    again = study.run("out", "Fails", options=("--retry", "failed"))
    assert "8 of 16 trials are done already" in again
    again = study.run("out", "Fails", options=("--retry", "timeout"))
    assert "16 of 16 trials are done already" in again
    status = [line.split() for line in study.call("status", study.folder / "out").split("\n")]
    assert ["two_player", "Fails", "0", "8", "0", "0", "0"] in status


def test_a_suite_may_grow_and_not_change(study):
    study.run("out", options=("--seeds", "1"))
    before, suite = (study.folder / "out" / FILE_NAME).read_bytes(), study.suite.read_text()
    for old, new, expected in (
        ("seeds = 4", "seeds = 5", "seeds was 4 and is 5"),
        ("time_limit = 20.0", "time_limit = 30.0", "time_limit was 20.0 and is 30.0"),
        ("[0.01, 0.1]", "[0.01]", "sigmas had 0.1 and has it no more"),
    ):
        study.suite.write_text(suite.replace(old, new))
        error = study.run("out", code=2)
        assert expected in error and "use another --out" in error
        assert (study.folder / "out" / FILE_NAME).read_bytes() == before
    study.suite.write_text(suite.replace("[0.01, 0.1]", "[0.01, 0.05, 0.1]"))
    assert "2 of 3 trials are done already" in study.run("out", options=("--seeds", "1"))


def test_provenance_is_stored(study):
    study.run("out", options=("--seeds", "1"))
    with read_store(study.folder / "out") as store:
        (run,) = store.runs()
    assert run.suite_text == study.suite.read_text()
    assert {"numpy", "casadi", "backend"} <= set(run.environment)
    assert run.seeds == 1
    assert {"python", "numpy", "casadi", "olne-bench"} <= set(run.versions)
    assert {"system", "processor", "cores"} <= set(run.machine)
    assert run.executor == "1 local processes"


def test_a_fresh_salt_is_kept_by_its_run(study):
    study.run("a", "Drawn", options=("--salt", "fresh", "--sigma", "0.01"))
    said = study.run("a", "Drawn", options=("--salt", "fresh"))  # the same command continues
    assert "8 of 16 trials are done already" in said
    assert "16 of 16 trials are done already" in study.run("a", "Drawn")
    fresh = study.rows("a")
    (own,) = set(fresh["salt_id"])
    with read_store(study.folder / "a") as store:
        salts = {read_suite_json(run.suite).salt for run in store.runs()}
    assert len(salts) == 1
    assert salt_id(*salts) == own
    assert f"salt {own} ('{min(salts)}')" in study.call("status", study.folder / "a")

    study.run("b", "Drawn")
    assert set(study.rows("b")["salt_id"]) == {salt_id("small")}
    differs = fresh["observation_error"] != study.rows("b")["observation_error"]
    assert differs.all()
    error = study.call("merge", study.folder / "a", study.folder / "b", code=2)
    assert f"its salt was {own} and is {salt_id('small')}" in error
    for other in ("another", "small"):
        error = study.run("a", "Drawn", options=("--salt", other), code=2)
        assert f"--salt '{other}' is not that of the run to continue, which has {own}" in error

    study.run("c", "Drawn", options=("--salt", *salts))  # the salt repeats the rows
    same(study.rows("c"), fresh)


@pytest.mark.skipif(not landlock_version(), reason="needs Landlock")
def test_a_plugin_cannot_change_its_own_code(study):
    study.plugin.write_text(
        study.plugin.read_text()
        + "\nwith open(__file__, 'a') as file:\n    file.write('\\nx = 1\\n')\n"
    )
    before = study.plugin.read_text()
    assert "PermissionError" in study.run("out", "Drawn", code=2)
    assert study.plugin.read_text() == before
