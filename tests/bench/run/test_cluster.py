"""Dask: the same rows as here, the same limits, and workers that may die."""

import signal
import socket
import time
from contextlib import suppress

import pandas as pd
import psutil
import pytest

from olne_bench.bench.run import cluster
from olne_bench.bench.run.cluster import _local_cluster, check_cluster, run_on_dask
from olne_bench.errors import UserError

DASK = ("--dask", "local:2")


@pytest.mark.long
def test_rows_are_those_of_a_local_run_and_limits_hold(study):
    study.suite.write_text(study.suite.read_text().replace("20.0", "5.0"))
    plugins = ("Drawn", "Fails", "Hangs")
    options = ("--seeds", "2", "--sigma", "0.1")
    said = study.call_alone(*study.arguments("dask", *plugins), *DASK, *options)
    assert "Traceback" not in said
    study.run("local", *plugins, options=options)
    rows = study.rows("dask")
    pd.testing.assert_frame_equal(rows, study.rows("local"), check_exact=True)
    status = rows.groupby("estimator")["status"].unique().map(list).to_dict()
    expected = {"Drawn": ["ok"], "Fails": ["crash"], "Hangs": ["timeout"], "uniform": ["ok"]}
    assert status == expected
    assert (
        rows.loc[rows["estimator"] == "Hangs", "message"] == "killed after 5 s of estimate"
    ).all()


@pytest.mark.long
def test_a_killed_dask_worker_loses_nothing(study):
    study.run("whole", "Slow", options=("--jobs", "2"))
    process = study.start(*study.arguments("killed", "Slow"), *DASK)
    driver = psutil.Process(process.pid)
    killed = 0
    end = time.monotonic() + 60
    while killed < 2 and process.poll() is None and time.monotonic() < end:
        time.sleep(0.5)
        # Dask's workers have child processes, which run trials.
        workers = [child for child in driver.children() if child.children()]
        if workers:
            time.sleep(0.5)
            with suppress(psutil.NoSuchProcess):  # the study may have ended meanwhile
                workers[killed % len(workers)].send_signal(signal.SIGKILL)
                killed += 1
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 0, errors
    assert killed
    pd.testing.assert_frame_equal(study.rows("killed"), study.rows("whole"), check_exact=True)


@pytest.mark.parametrize(
    "address",
    [
        *("local:", "local:0", "local:x", "local:\u0662", "local:\u00b2", "local:1_0", "local:+1"),
        *("local: 1", "local:1025", "local:99999999", "login1:8786", "nonsense", ""),
        *("tcp://", "tcp://host", "tcp://host:", "tcp://host:0", "tcp://host:65536"),
        *("tcp://host:\u0661", "tcp://a b:1", "tcp://:8786", "http://host:8786"),
    ],
)
def test_an_address_that_cannot_be_is_refused(address):
    with pytest.raises(UserError, match="expected"):
        check_cluster(address)


def test_workers_on_this_machine_are_counted():
    check_cluster("local:1")
    check_cluster("local:1024")


@pytest.mark.parametrize("suite", ["quick", "online"])
def test_a_scheduler_that_is_not_there_leaves_no_folder(study, monkeypatch, suite):
    monkeypatch.setattr(cluster, "_CONNECT_SECONDS", 0.1)
    for address in ("tcp://127.0.0.1:9", "tcp://no.such.host.invalid:8786"):
        words = ("run", suite, "--out", study.folder / "out", "--dask", address)
        assert "cannot connect" in study.call(*words, code=2)
        assert not (study.folder / "out").exists()


def test_a_scheduler_that_begins_to_listen_is_waited_for(monkeypatch):
    waits = []
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        monkeypatch.setattr(cluster.time, "sleep", waits.append)
        tried = iter([ConnectionRefusedError(), taken])

        def connect(*_, **__):
            found = next(tried)
            if isinstance(found, OSError):
                raise found
            return found

        monkeypatch.setattr(cluster.socket, "create_connection", connect)
        check_cluster(address)
    assert len(waits) == 1


def test_a_scheduler_that_is_lost_is_reported(monkeypatch):
    monkeypatch.setattr("olne_bench.bench.run.cluster._CONNECT_SECONDS", 1.0)

    with pytest.raises(UserError, match="cannot connect"):
        list(run_on_dask([], cluster="tcp://127.0.0.1:9"))


def test_a_worker_that_dies_as_its_cluster_starts_is_started_again(monkeypatch):
    starts = []

    def fails_twice(**options):
        starts.append(options["n_workers"])
        if len(starts) < 3:
            raise RuntimeError("Nanny failed to start.")
        return "cluster"

    monkeypatch.setattr("distributed.LocalCluster", fails_twice)
    assert _local_cluster(2) == "cluster"
    assert starts == [2, 2, 2]
    monkeypatch.setattr("olne_bench.bench.run.cluster._STARTS", 2)
    starts.clear()
    with pytest.raises(RuntimeError, match="Nanny"):
        _local_cluster(2)


def test_a_scheduler_that_says_nothing_is_given_up(monkeypatch):
    monkeypatch.setattr(cluster, "_CONNECT_SECONDS", 120.0)
    monkeypatch.setattr(cluster, "_GREETING_SECONDS", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(UserError, match="no answer within 1 s"):
            list(cluster.run_on_dask([], cluster=address))


class Ended:
    """A task that ran one trial, in a quarter of an hour."""

    status = "finished"

    def __init__(self, trials):
        self.trials = trials

    def result(self):
        return ["outcome"], 900.0

    def add_done_callback(self, put):
        put(self)


class Slow:
    """A client whose tasks end at once, as if each had taken long."""

    status = "running"

    def nthreads(self):
        return {"worker": 1}

    def submit(self, _function, trials, *_places, **_options):
        return Ended(trials)


def test_trials_that_take_long_are_all_run():
    run = cluster._Run(Slow(), cluster._Places(None, None, None), lambda: False)
    assert list(run.run(iter(range(12)))) == [(trial, "outcome") for trial in range(12)]


class Frozen:
    """A client whose scheduler does not answer."""

    status = "running"

    def nthreads(self):
        time.sleep(1000)


def test_a_scheduler_that_freezes_is_given_up(monkeypatch):
    monkeypatch.setattr(cluster, "_SILENCE_SECONDS", 0.3)
    run = cluster._Run(Frozen(), cluster._Places(None, None, None), lambda: False)
    time.sleep(0.5)
    with pytest.raises(UserError, match=r"has not answered for 0\.3 s"):
        run._check_connection()
