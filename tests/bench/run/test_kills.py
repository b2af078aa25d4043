"""Kills (-9) at random moments do not change the table of a run."""

import time

import numpy as np
import pandas as pd
import psutil
import pytest


@pytest.mark.long
def test_kills_of_driver_and_workers_change_nothing(study):
    study.run("whole", "Slow", options=("--jobs", "2"))
    rng = np.random.default_rng(0)
    arguments = study.arguments("killed", "Slow")
    process = study.start(*arguments)
    for number in range(6):
        time.sleep(rng.uniform(0.3, 2.5))
        if process.poll() is not None:
            break
        workers = psutil.Process(process.pid).children()
        if number % 2 and workers:
            workers[rng.integers(len(workers))].kill()
        else:
            process.kill()
            process.communicate()
            process = study.start(*arguments)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 0, errors
    pd.testing.assert_frame_equal(study.rows("killed"), study.rows("whole"), check_exact=True)


def test_a_killed_driver_leaves_no_process_behind(study):
    process = study.start(*study.arguments("out", "Hangs"))
    end = time.monotonic() + 30
    while not (workers := psutil.Process(process.pid).children()) and time.monotonic() < end:
        time.sleep(0.1)
    time.sleep(2)
    process.kill()
    process.communicate()
    gone, alive = psutil.wait_procs(workers, timeout=5)
    assert gone
    assert not alive
