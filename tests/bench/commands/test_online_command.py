"""Studies of streams."""

import re
import shutil
import signal
import time

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.judge.trials import case_of
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.trial import expand
from olne_bench.bench.report.stream_tables import COLUMNS
from olne_bench.bench.run.resume import last_suite
from olne_bench.bench.run.store import read_store

SUITE = """
name = "small"
kind = "streams"
rules = { deadline = 10.0 }
scenarios = ["two_player"]
sensors = ["full"]
sigmas = [0.01]
seeds = 2
time_limit = 20.0
estimators = ["uniform", "map"]
"""
KINDS = ["constant_velocity", "constant_controls", "cloned", "true_weights", "uniform", "map"]

PLUGIN = """
import time
from types import SimpleNamespace

class Steady:
    name = "Steady"
    def estimate(self, problem, observation, *, rng, budget):
        raise RuntimeError("online, it is not asked")
    def start(self, problem, *, rng, lag=None):
        self.count, self.weights = 0, rng.uniform(0.5, 1, (2, 4))
        return self
    def update(self, sample, *, budget):
        self.count += 1
        self.act(sample)
        return SimpleNamespace(weights=self.weights)
    def act(self, sample):
        pass

class Hangs(Steady):
    name = "Hangs"
    def act(self, sample):
        if self.count == 3 and sample[0, 0] > BETWEEN:
            time.sleep(4321.25)

class Slow(Steady):
    name = "Slow"
    def act(self, sample):
        time.sleep(0.05)
"""


def reproducible(path) -> pd.DataFrame:
    return pd.read_csv(path / "updates.csv").drop(columns="latency")


def test_a_study_goes_on_where_it_stopped(study) -> None:
    study.suite.write_text(SUITE)
    out = study.folder / "streams"
    words = ["run", study.suite, "--out", out, "--rule", "lag=20", "--jobs", 1]
    said = study.call(*words, "--seeds", 1)
    rows = pd.read_csv(out / "updates.csv")
    assert tuple(rows.columns) == COLUMNS
    assert list(dict.fromkeys(rows["estimator"])) == KINDS
    assert (rows.groupby("estimator")["sample"].max() == 25).all()
    assert set(rows["status"]) <= {"ok", "failed_forward"}
    last = rows[(rows["estimator"] == "map") & (rows["sample"] == 25)].iloc[0]
    assert last["cosine_error"] < last["prior_error"] + 0.05
    assert 0 < last["latency"] < 10
    summary = pd.read_csv(out / "summary.csv")
    assert summary["estimator"].tolist() == KINDS and (summary["failed"] == 0).all()
    assert len(pd.read_csv(out / "over_time.csv")) == len(KINDS) * 25
    with read_store(out) as store:
        kept = last_suite(store.runs(), out)
    assert (kept.name, kept.rules.given) == ("small (changed)", {"deadline": 10.0, "lag": 20})
    assert "fde_3s" in said and "map" in said
    assert (out / "figures" / "online_two_player_full.png").is_file()
    assert "7 of 14 trials are done already" in study.call(*words, "--no-figures")
    more = pd.read_csv(out / "updates.csv")
    same = more[more["seed"] == 0].reset_index(drop=True)
    pd.testing.assert_frame_equal(same, rows)  # latencies included: they are the former rows
    assert len(more) == 2 * len(rows)
    refused(study, out, words)


def refused(study, out, words) -> None:
    """What would mix two studies is refused, and nothing is written."""
    before = (out / "updates.csv").read_bytes()
    said = study.call(*words, "--rule", "lag=19", code=2)
    assert "its rule lag was 20 and is 19" in said
    said = study.call(*words, "--rule", "deadline=null", code=2)
    assert "its rule deadline was 10.0 and is the default" in said
    said = study.call(*words[:-4], code=2)
    assert "holds a run of suite 'small (changed)', not 'small'" in said
    for command in (("gate", out), ("compare", out, out)):
        said = study.call(*command, code=2)
        assert "is a study of streams: it has no tables of trials" in said
    study.suite.write_text(SUITE.replace("20.0", "21.0"))
    assert "time_limit was 20.0 and is 21.0" in study.call(*words, code=2)
    study.suite.write_text(SUITE)
    assert "kind was streams and is trials" in study.call(*words[:4], "--kind", "trials", code=2)
    assert (out / "updates.csv").read_bytes() == before


@pytest.mark.long
def test_studies_of_two_machines_become_one(study) -> None:
    study.suite.write_text(SUITE.replace('"uniform", "map"', '"uniform"'))
    words = ["run", study.suite, "--no-figures", "--jobs", 1]
    one, two, both = (study.folder / name for name in ("one", "two", "both"))
    study.call(*words, "--out", one, "--seeds", 1)
    said = study.call("status", one)
    assert "'olne-bench run' with this --out runs missing and stale trials" in said
    assert re.search(r"uniform +1 +0 +0 +0 +1", said)  # done, failed, faults, stale, missing
    study.call(*words, "--kind", "trials", "--out", two, "--seeds", 1)
    said = study.call("merge", two, one, code=2)
    assert "holds a run of suite 'small (changed)', not 'small'" in said
    shutil.rmtree(two)
    study.call(*words, "--out", two)
    said = study.call("merge", one, two, "--out", both)
    assert "6 rows of" in said and "6 were there before" in said
    assert "12 of 12 trials are done already" in study.call(*words, "--out", both)
    pd.testing.assert_frame_equal(reproducible(both), reproducible(two))


@pytest.mark.long
def test_a_plugin_that_hangs_costs_its_own_motion(study) -> None:
    study.suite.write_text(SUITE.replace('"uniform", "map"', '"uniform"').replace("20.0", "2.0"))
    given = [
        case_of(one).observations[0].y[2, 0, 0]
        for one in expand(load_suite(str(study.suite)))
        if one.estimator.label == "uniform"
    ]
    plugin = study.folder / "streams.py"
    plugin.write_text(PLUGIN.replace("BETWEEN", repr(float(np.mean(given)))))
    out = study.folder / "hangs"
    words = ["--plugin", f"{plugin}:Hangs", "--plugin", f"{plugin}:Steady", "--no-figures"]
    study.call("run", study.suite, "--out", out, *words, "--jobs", 2)
    rows = pd.read_csv(out / "updates.csv")
    assert set(rows.loc[rows["estimator"] != "Hangs", "status"]) <= {"ok", "failed_forward"}
    hung = rows[rows["status"] == "timeout"]
    assert hung["seed"].unique().tolist() == [int(np.argmax(given))]
    assert set(hung["message"]) == {"killed after 2 s of update"}
    assert hung["sample"].tolist() == list(range(3, 26))
    own = rows[(rows["estimator"] == "Hangs") & (rows["status"] != "timeout")]
    assert len(own) == 25 + 2 and set(own["status"]) == {"ok"}


@pytest.mark.long
@pytest.mark.parametrize("where", [("--jobs", 2), ("--dask", "local:2")], ids=["jobs", "dask"])
def test_rows_do_not_depend_on_where_they_are_made(study, where) -> None:
    study.suite.write_text(SUITE)
    words = ["run", study.suite, "--rule", "deadline=60", "--no-figures"]
    study.call(*words, "--out", study.folder / "one", "--jobs", 1)
    study.call_alone(*words, "--out", study.folder / "more", *where)
    one, more = reproducible(study.folder / "one"), reproducible(study.folder / "more")
    pd.testing.assert_frame_equal(one, more, check_exact=True)


@pytest.mark.long
def test_an_interrupted_study_loses_nothing(study) -> None:
    study.suite.write_text(SUITE.replace('"uniform", "map"', '"uniform"'))
    plugin = study.folder / "streams.py"
    plugin.write_text(PLUGIN)
    words = ["run", study.suite, "--plugin", f"{plugin}:Slow", "--no-figures", "--jobs", 1]
    study.call(*words, "--out", study.folder / "whole")
    part = study.folder / "part"
    process = study.start(*words, "--out", part)
    end = time.monotonic() + 60
    while time.monotonic() < end and "Slow" not in str(study_rows(part)):
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 128 + signal.SIGINT, errors
    assert re.search(r"interrupted: \d+ trials of this run are stored", errors)
    study.call(*words, "--out", part)
    whole = reproducible(study.folder / "whole")
    pd.testing.assert_frame_equal(whole, reproducible(part), check_exact=True)


def study_rows(part) -> list:
    """Estimators with a row in a store that is being written."""
    import sqlite3

    try:
        with sqlite3.connect(f"file:{part}/trials.sqlite?mode=ro", uri=True) as store:
            return store.execute("SELECT estimator FROM trials").fetchall()
    except sqlite3.Error:
        return []


def test_what_cannot_be_run_is_refused(study) -> None:
    out = study.folder / "streams"
    study.suite.write_text(SUITE + "trajectories = 2\n")
    said = study.call("run", study.suite, "--out", out, code=2)
    assert "has 2 trajectories; in a study of streams there is one motion at a time" in said
    study.suite.write_text(SUITE)
    said = study.call("run", study.suite, "--rule", "lag=26", "--out", out, code=2)
    assert "a motion of scenario 'two_player' has 25 samples; use fewer" in said
    study.suite.write_text(SUITE.replace('"map"', '{name = "map", label = "stock"}'))
    said = study.call("run", study.suite, "--out", out, code=2)
    assert "an estimator is called 'stock'" in said
    assert not out.exists()


def test_foreign_scenarios_are_refused(study) -> None:
    (study.folder / "world.py").write_text(
        "from olne_bench.envs.scenarios import get_scenario\n"
        "class World:\n    name = 'World'\n    def draw(self):\n"
        "        return get_scenario('two_player')\n"
    )
    study.suite.write_text(SUITE.replace('"two_player"', f'"{study.folder}/world.py"'))
    said = study.call("run", study.suite, "--out", study.folder / "streams", code=2)
    assert "in a study of streams, scenarios and sensors are built-in ones" in said
