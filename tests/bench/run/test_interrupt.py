"""Ctrl-C, full disks and clocks: runs end in order, and continue as if nothing had happened."""

import os
import resource
import signal
import time

import pandas as pd
import pytest

from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.trial import expand
from olne_bench.bench.run.executor import run_trials
from olne_bench.bench.run.store import read_store


def stored(folder):
    try:
        with read_store(folder) as store:
            return sum(map(len, store.records().values()))
    except Exception:
        return 0


@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)]
)
def test_an_interrupted_run_ends_at_once_and_goes_on(study, number):
    arguments = study.arguments("out", "Slow")
    out = study.folder / "out"
    process = study.start(*arguments)
    end = time.monotonic() + 60
    while stored(out) < 3 and time.monotonic() < end:
        time.sleep(0.1)
    if number == signal.SIGINT:
        os.killpg(process.pid, number)  # to all processes, as a terminal does
    else:
        process.send_signal(number)
    interrupted = time.monotonic()
    _, errors = process.communicate(timeout=60)
    assert time.monotonic() - interrupted < 3
    assert process.returncode == 128 + number
    last = errors.strip().splitlines()[-1]
    assert last.startswith("interrupted: ")
    assert "run the same command again to continue" in last
    kept = stored(out)
    assert f"interrupted: {kept} trials" in last
    assert 3 <= kept < 16
    assert f"{kept} of 16 trials are done already" in study.run(
        "out", "Slow", options=("--jobs", "2")
    )
    if number == signal.SIGTERM:
        study.run("whole", "Slow", options=("--jobs", "2"))
        pd.testing.assert_frame_equal(study.rows("out"), study.rows("whole"), check_exact=True)


#: Bytes that hold the tables of a store, but not 80 trials.
_DISK = 150_000


@pytest.mark.long
def test_a_full_disk_is_one_line_and_loses_nothing(study):
    # A limit on the size of files looks like a full disk to the store.
    study.suite.write_text(study.suite.read_text().replace("seeds = 4", "seeds = 40"))

    def fill():
        resource.setrlimit(resource.RLIMIT_FSIZE, (_DISK, _DISK))

    error = study.call_alone(*study.arguments("out"), code=2, preexec_fn=fill)
    last = error.strip().splitlines()[-1]
    assert last.startswith("olne-bench: error: cannot use")
    assert "nothing stored is lost" in last
    kept = stored(study.folder / "out")
    assert 0 < kept < 80
    assert f"{kept} of 80 trials are done already" in study.run("out")
    assert len(study.rows("out")) == 80


def test_a_clock_that_jumps_does_not_end_trials(study, monkeypatch):
    now = time.time()
    monkeypatch.setattr(time, "time", lambda: now + 1e6 * time.perf_counter())
    trials = list(expand(load_suite(str(study.suite)), seeds=1))
    outcomes = [outcome for _, outcome in run_trials(trials, jobs=1)]
    assert [outcome.status for outcome in outcomes] == ["ok", "ok"]
